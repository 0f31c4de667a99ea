//! Error of volume of spheres drawn as polygons, by end rule: the table "Volume of spheres by end rule" of docs/evaluation.md.
//!
//! `cargo bench --bench volumes -- [PLACEMENTS [interslice options as NAME=VALUE]]`, for instance `-- 50 fair=0 motion=none`

#[path = "../tests/shapes/spheres.rs"]
mod spheres;

use interslice::Settings;
use interslice::settings::EndRule;
use rayon::prelude::*;
use spheres::{sphere_volume, spheres, spread, volumes};

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
    println!(
        "Error of volume, %: mean [least, largest] of {count} spheres each, drawn on three slices or more; mesh\n"
    );
    println!("| sphere, mm | slices, mm | flat | half-slice | extrapolate | extrapolate, by areas |");
    println!("|---|---|---|---|---|---|");
    let mut all: [Vec<f64>; 4] = Default::default();
    for gap in GAPS {
        for diameter in DIAMETERS {
            let stacks = spheres(diameter, gap, count);
            if stacks.len() < count {
                continue;
            }
            let row: [Vec<f64>; 4] = errors(&stacks, diameter, &settings);
            println!("| {diameter} | {gap} | {} |", row.each_ref().map(|v| cell(v)).join(" | "));
            // What is published is of slices no farther apart.
            if gap < 3.0 {
                all.iter_mut().zip(row).for_each(|(all, row)| all.extend(row));
            }
        }
    }
    println!("| all | 1 and 2 | {} |", all.each_ref().map(|v| cell(v)).join(" | "));
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
fn errors(stacks: &[interslice::ContourStack], diameter: f64, settings: &Settings) -> [Vec<f64>; 4] {
    let exact = sphere_volume(diameter);
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
