//! Error of volume of bodies drawn as polygons, by end rule: the tables of "Volume by end rule" in docs/evaluation.md.
//!
//! `cargo bench --bench volumes -- [PLACEMENTS] [spheres] [nelms] [interslice options as NAME=VALUE]`, for instance `-- 50 fair=0 motion=none`;
//! one of both tables where it is named.

#[path = "../tests/shapes/spheres.rs"]
mod spheres;

use interslice::Settings;
use interslice::settings::EndRule;
use rayon::prelude::*;
use spheres::{NELMS, sphere_volume, spheres, spread, upright, volumes};

const DIAMETERS: [f64; 8] = [3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0];
const GAPS: [f64; 3] = [1.0, 2.0, 3.0];
const RULES: [EndRule; 3] = [EndRule::Flat, EndRule::HalfSlice, EndRule::Extrapolate];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let count = words.iter().find_map(|word| word.parse().ok()).unwrap_or(50);
    let options: Vec<&String> = words.iter().filter(|word| word.contains('=')).collect();
    let settings = match settings(&options) {
        Ok(settings) => settings,
        Err(message) => return println!("{message}"),
    };
    let asked = |table: &str| {
        !["spheres", "nelms"].iter().any(|t| words.iter().any(|w| w == t)) || words.iter().any(|w| w == table)
    };
    println!("Error of volume, %: mean [least, largest] of {count} places each, drawn on three slices or more; mesh\n");
    if asked("spheres") {
        sphere_table(count, &settings);
    }
    if asked("nelms") {
        nelms_table(count, &settings);
    }
}

fn head(body: &str) {
    println!("| {body} | slices, mm | flat | half-slice | extrapolate | extrapolate, by areas |");
    println!("|---|---|---|---|---|---|");
}

fn row(body: &str, gaps: &str, errors: &[Vec<f64>; 4]) {
    println!("| {body} | {gaps} | {} |", errors.each_ref().map(|v| cell(v)).join(" | "));
}

fn sphere_table(count: usize, settings: &Settings) {
    head("sphere, mm");
    let mut all: [Vec<f64>; 4] = Default::default();
    for gap in GAPS {
        for diameter in DIAMETERS {
            let stacks = spheres(diameter, gap, count);
            if stacks.len() < count {
                continue;
            }
            let errors = errors(&stacks, sphere_volume(diameter), settings);
            row(&diameter.to_string(), &gap.to_string(), &errors);
            // What is published is of slices no farther apart.
            if gap < 3.0 {
                all.iter_mut().zip(errors).for_each(|(all, errors)| all.extend(errors));
            }
        }
    }
    row("all", "1 and 2", &all);
}

/// The same of the bodies of Nelms et al. 2015.
fn nelms_table(count: usize, settings: &Settings) {
    head("body, mm³");
    for body in NELMS {
        for gap in GAPS {
            let stacks = upright(body.radius, 1000 + gap as u64, gap, count);
            row(&format!("{}, {}", body.name, body.volume), &gap.to_string(), &errors(&stacks, body.volume, settings));
        }
    }
}

/// Settings from lines of a settings file.
fn settings(options: &[&String]) -> Result<Settings, String> {
    let line = |option: &&String| {
        let (name, value) = option.split_once('=').unwrap_or((option, ""));
        let bare = value.parse::<f64>().is_ok() || value == "true" || value == "false";
        if bare { format!("{name} = {value}\n") } else { format!("{name} = \"{value}\"\n") }
    };
    toml::from_str(&options.iter().map(line).collect::<String>()).map_err(|e| e.to_string())
}

/// Errors in percent, by rule, and by areas instead of the mesh for the last rule.
fn errors(stacks: &[interslice::ContourStack], exact: f64, settings: &Settings) -> [Vec<f64>; 4] {
    let of = |stack: &interslice::ContourStack| {
        let by = |rule| {
            let settings = Settings { end_bottom: rule, end_top: rule, ..settings.clone() };
            volumes(stack, &settings).map_or([f64::NAN; 3], |v| v.map(|v| 100.0 * (v / exact - 1.0)))
        };
        let [flat, half, caps] = RULES.map(by);
        [flat[0], half[0], caps[0], caps[1]]
    };
    let all: Vec<[f64; 4]> = stacks.par_iter().map(of).collect();
    std::array::from_fn(|k| all.iter().map(|v| v[k]).collect())
}

fn cell(values: &[f64]) -> String {
    let [mean, least, largest] = spread(values);
    format!("{mean:.2} [{least:.1}, {largest:.1}]")
}
