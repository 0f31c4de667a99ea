//! The page's sections, filled into its template.

use std::fmt::Write;

use clap::Args;

use super::plots::{self, Bar};
use super::scene::PageScene;
use super::words::{self, count, escape, height, least_gap, link, number};
use crate::report::{BodyEnd, EndReport, Provenance, Report, Residual, StepBeside};
use crate::settings::Settings;

const TEMPLATE: &str = include_str!("template.html");
const STYLE: &str = include_str!("page.css");
const VIEWER: &str = include_str!("viewer.js");

/// The whole page. Whatever comes from a user is escaped. Meshes that are written are simpler than the page's where `simplify` says the error.
pub fn page(title: &str, report: &Report, extent: [f64; 2], scene: &PageScene, simplify: Option<f64>) -> String {
    // Numbers and base64: no sign of it can end the element it stands in.
    let numbers = serde_json::to_string(scene).unwrap_or_default();
    let fills = [
        ("title", escape(title)),
        ("style", STYLE.into()),
        ("script", VIEWER.into()),
        ("scene", numbers),
        ("verdict", verdict(report)),
        ("figures", figures(report, scene.heights().unwrap_or(extent))),
        ("simplified", simplify.map_or(String::new(), |error| simplified(report, error))),
        ("shown", shown(report, scene)),
        ("warnings", warnings(report)),
        ("areas", areas(report)),
        ("volumes", volumes(report)),
        ("contours", contours(report)),
        ("unit", escape(&report.unit)),
        ("events", events(report)),
        ("settings", settings(&report.settings)),
        ("run", run(report)),
    ];
    fill(TEMPLATE, &fills)
}

/// Fills a template: texts take the places of their names, `{{name}}`. What is put in is not looked at again.
pub(crate) fn fill(template: &str, fills: &[(&str, String)]) -> String {
    let mut out = String::with_capacity(template.len() + fills.iter().map(|(_, text)| text.len()).sum::<usize>());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        out.push_str(before);
        let (name, behind) = after.split_once("}}").unwrap_or((after, ""));
        out.extend(fills.iter().find(|(known, _)| *known == name).map(|(_, text)| text.as_str()));
        rest = behind;
    }
    out + rest
}

/// Section of the checks and whether they hold, and no more.
fn verdict(report: &Report) -> String {
    let all = report.contours.len();
    let pixels: usize = report.contours.iter().map(|c| c.differing_pixels).sum();
    let off = report.contours.iter().filter(|c| c.differing_pixels > 0).count();
    if !report.broken.is_empty() {
        let title = match off {
            0 => "Not everything holds that was checked.".into(),
            _ => format!("{off} of {all} contours are not met, by {} pixels.", count(pixels as u64)),
        };
        let items: String = report.broken.iter().map(|b| format!("<li>{}</li>", escape(b))).collect();
        return format!(r#"<div class="verdict bad"><strong>{title}</strong><ul>{items}</ul></div>"#);
    }
    let body = &report.body;
    let sides = report.contours.iter().flat_map(|c| [c.below, c.above]).flatten();
    let (mut looked, mut most) = (0, 0.0f64);
    sides.for_each(|beside| (looked, most) = (looked + 1, most.max(beside.jump)));
    let beside = match looked {
        0 => "What lies just beside the contours was not looked at.".into(),
        _ => format!(
            "A thousandth of the gap beside them ({looked} places) the surface is at most {} pixels away from them.",
            number(most)
        ),
    };
    format!(
        r#"<p class="verdict good"><strong>Everything holds that was checked.</strong> In all {all} contours no pixel of the result differs from what was drawn. {beside} No piece of the body and no void in it lies between contours without touching one, and all {} pairs of parts that overlap from contour to contour are connected.</p>"#,
        count(body.overlapping as u64)
    )
}

fn figures(report: &Report, [lowest, highest]: [f64; 2]) -> String {
    let unit = escape(&report.unit);
    let mut out = String::new();
    let mut figure = |name: &str, value: String| {
        let _ = write!(out, "<div><dt>{name}</dt><dd>{value}</dd></div>");
    };
    if let Some(volume) = report.volume {
        let litres =
            if report.unit == "mm" { format!("<small>{} ml</small>", number(volume / 1000.0)) } else { String::new() };
        figure("Volume", format!("{} {unit}³{litres}", number(volume)));
    }
    if let Some(area) = report.area {
        figure("Surface", format!("{} {unit}²", number(area)));
    }
    let gap = least_gap(&report.contours);
    figure("Body from height", format!("{} to {} {unit}", height(lowest, gap), height(highest, gap)));
    let extra = report.contours.iter().filter(|c| c.extra).count();
    let extra = if extra > 0 { format!("<small>{extra} of them added</small>") } else { String::new() };
    figure("Contours", format!("{}{extra}", report.contours.len()));
    figure(
        "Image",
        format!(
            "{} × {} pixels<small>of {} × {} {unit}</small>",
            report.dims[0],
            report.dims[1],
            number(report.spacing[0]),
            number(report.spacing[1])
        ),
    );
    out
}

/// A word on meshes that are simpler than that of the figures.
fn simplified(report: &Report, error: f64) -> String {
    format!(
        r#"<p class="note">Volume, surface and triangles on this page are those of the mesh before it was simplified; mesh files hold the simpler one, up to {} {} away (--simplify).</p>"#,
        number(error),
        escape(&report.unit)
    )
}

fn shown(report: &Report, scene: &PageScene) -> String {
    let mut out = format!("The red lines are the contours as drawn. {} triangles", count(scene.drawn as u64));
    if scene.cell > 0.0 {
        let _ = write!(
            out,
            " here, thinned for this page from the {} of the result (points closer than {} {} became one)",
            count(scene.all),
            number(scene.cell),
            escape(&report.unit)
        );
    }
    out.push('.');
    if scene.stretch > 1.0 {
        let _ = write!(out, " <strong>Heights are drawn {:.1} times larger than they are.</strong>", scene.stretch);
    }
    out
}

fn warnings(report: &Report) -> String {
    if report.warnings.is_empty() {
        return String::new();
    }
    let items: String = report.warnings.iter().map(|w| format!("<li>{}</li>", escape(w))).collect();
    format!(
        r#"<section class="warnings" aria-labelledby="warned"><h2 id="warned">Please look at this</h2><ul>{items}</ul></section>"#
    )
}

fn areas(report: &Report) -> String {
    report.areas.as_ref().map_or(String::new(), |areas| plots::areas(areas, &report.contours, &report.unit))
}

/// The volume as made, and as other end rules would make it.
fn volumes(report: &Report) -> String {
    let Some(areas) = &report.areas else { return String::new() };
    let side = |side: BodyEnd| report.ends.iter().find(|e| e.side == side);
    let (bottom, top) = (side(BodyEnd::Bottom), side(BodyEnd::Top));
    let bar = |name: String, of: fn(&EndReport) -> f64| Bar {
        name,
        parts: [bottom.map_or(0.0, of), areas.between_contours, top.map_or(0.0, of)],
    };
    let Settings { end_bottom, end_top, .. } = &report.settings;
    let bars = [
        bar(format!("in use: below {end_bottom}, above {end_top}"), |e| e.used),
        bar("flat".into(), |_| 0.0),
        bar("half-slice".into(), |e| e.half_slice),
        bar("extrapolate".into(), |e| e.extrapolate),
    ];
    let unit = escape(&report.unit);
    let mut out = plots::volumes(&bars, &report.unit);
    let _ = write!(
        out,
        r#"<div class="wide"><table><caption>Volume in {unit}³</caption><thead><tr><th scope="col">End rule</th><th scope="col">below</th><th scope="col">between</th><th scope="col">above</th><th scope="col">all</th></tr></thead><tbody>"#
    );
    for bar in &bars {
        let [below, between, above] = bar.parts.map(number);
        let _ = write!(
            out,
            r#"<tr><th scope="row">{}</th><td>{below}</td><td>{between}</td><td>{above}</td><td>{}</td></tr>"#,
            escape(&bar.name),
            number(bar.whole())
        );
    }
    out + "</tbody></table></div>"
}

fn contours(report: &Report) -> String {
    let gap = least_gap(&report.contours);
    let residual = |r: &Option<Residual>| match r {
        Some(r) => format!("<td>{}</td><td>{}</td>", number(r.mean), number(r.max)),
        None => "<td>–</td><td>–</td>".into(),
    };
    let step = |beside: &Option<StepBeside>| match beside {
        Some(beside) => {
            let met = if beside.holds() { "met" } else { "off" };
            format!(r#"<td class="{met}">{}</td>"#, number(beside.jump))
        }
        None => "<td>–</td>".into(),
    };
    let mut out = String::new();
    for (k, c) in report.contours.iter().enumerate() {
        let added = if c.extra { " <small>added</small>" } else { "" };
        let met = if c.differing_pixels == 0 { "met" } else { "off" };
        let _ = write!(
            out,
            r#"<tr><th scope="row"><button type="button" data-contour="{}" aria-pressed="false">{}</button>{added}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class="{met}">{}</td>{}{}{}{}</tr>"#,
            k + 1,
            escape(&c.name),
            height(c.z, gap),
            c.components,
            c.holes,
            count(c.pixels as u64),
            count(c.differing_pixels as u64),
            step(&c.below),
            step(&c.above),
            residual(&c.arrival_from_below),
            residual(&c.arrival_from_above),
        );
    }
    out
}

fn events(report: &Report) -> String {
    let (unit, gap) = (escape(&report.unit), least_gap(&report.contours));
    let (mut out, mut quiet) = (String::new(), 0);
    for (interval, ends) in report.intervals.iter().zip(report.contours.windows(2)) {
        let mut told = words::events(&interval.events);
        told.extend(interval.links.iter().map(link));
        if told.is_empty() {
            quiet += 1;
            continue;
        }
        let items: String = told.iter().map(|t| format!("<li>{}</li>", escape(t))).collect();
        let _ = write!(
            out,
            "<h3>From {} to {} {unit} <small>{} to {}</small></h3><ul>{items}</ul>",
            height(interval.z_low, gap),
            height(interval.z_high, gap),
            escape(&ends[0].name),
            escape(&ends[1].name)
        );
    }
    match (out.is_empty(), quiet) {
        (true, _) => {
            "<p>Nowhere do parts split, merge, begin or end between two contours, and no hole opens or closes.</p>"
                .into()
        }
        (false, 0) => out,
        (false, 1) => out + "<p>Nothing of the kind happens in the other gap.</p>",
        (false, _) => format!("{out}<p>Nothing of the kind happens in the other {quiet} gaps.</p>"),
    }
}

/// Every setting with its own help text; those that differ from the default are marked.
fn settings(settings: &Settings) -> String {
    let values = |s: &Settings| serde_json::to_value(s).ok().and_then(|v| v.as_object().cloned()).unwrap_or_default();
    let (used, usual) = (values(settings), values(&Settings::default()));
    let options = Settings::augment_args(clap::Command::new("settings"));
    let mut out = String::new();
    for (name, value) in &used {
        let help = options.get_arguments().find(|a| a.get_id() == name.as_str()).and_then(|a| a.get_help());
        let shown = match value {
            serde_json::Value::String(text) => text.clone(),
            serde_json::Value::Null => "–".into(),
            other => other.to_string(),
        };
        let changed = if usual.get(name) == Some(value) { "" } else { r#" class="changed""# };
        let _ = write!(
            out,
            r#"<tr{changed}><th scope="row">{}</th><td>{}</td><td>{}</td></tr>"#,
            escape(name),
            escape(&shown),
            escape(&help.map(ToString::to_string).unwrap_or_default())
        );
    }
    out
}

fn run(report: &Report) -> String {
    let reason = report.backend_reason.as_ref().map_or(String::new(), |r| format!("<small>{}</small>", escape(r)));
    let mut out = format!(
        r#"<dl class="figures"><div><dt>Program</dt><dd>interslice {}</dd></div><div><dt>Computed on</dt><dd>{}{reason}</dd></div></dl>"#,
        escape(&report.version),
        escape(&report.backend)
    );
    out += &report.provenance.as_ref().map_or(String::new(), made);
    if report.stages.is_empty() {
        return out + "<p>This run took no times.</p>";
    }
    let all: f64 = report.stages.iter().map(|s| s.seconds).sum();
    out.push_str(r#"<table><caption>Seconds</caption><thead><tr><th scope="col">Stage</th><th scope="col">seconds</th></tr></thead><tbody>"#);
    for stage in &report.stages {
        let _ = write!(out, r#"<tr><th scope="row">{}</th><td>{:.3}</td></tr>"#, escape(&stage.name), stage.seconds);
    }
    let _ = write!(out, r#"</tbody><tfoot><tr><th scope="row">all</th><td>{all:.3}</td></tr></tfoot></table>"#);
    out
}

/// Of what, with which options, when and where.
fn made(provenance: &Provenance) -> String {
    let Provenance { date, inputs, bodies, options, machine } = provenance;
    let mut rows = Vec::new();
    rows.extend(date.iter().map(|date| ("Date", escape(date))));
    rows.extend(inputs.iter().map(|f| {
        let digest =
            format!("{}<small>{} bytes, SHA-256 {}</small>", escape(&f.file), count(f.bytes), escape(&f.sha256));
        ("Input", digest)
    }));
    if !bodies.is_empty() {
        rows.push(("Body", escape(&bodies.join(", "))));
    }
    let given = options.iter().map(|(name, value)| format!("{} {}", escape(name), escape(&value.to_string())));
    rows.push(("Options", if options.is_empty() { "none".into() } else { given.collect::<Vec<_>>().join(", ") }));
    rows.extend(machine.iter().map(|m| {
        ("Machine", format!("{}<small>{}, {}</small>", escape(&m.host), escape(&m.system), escape(&m.architecture)))
    }));
    let rows: String =
        rows.iter().map(|(name, text)| format!(r#"<tr><th scope="row">{name}</th><td>{text}</td></tr>"#)).collect();
    format!(r#"<table class="made"><caption>Made of</caption><tbody>{rows}</tbody></table>"#)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_in_is_not_looked_at_again() {
        let fills = [("a", "{{b}}".to_string()), ("b", "x".to_string())];
        assert_eq!(fill("<{{a}}|{{b}}|{{c}}>", &fills), "<{{b}}|x|>");
    }

    #[test]
    fn every_place_of_the_template_is_filled() {
        let report = Report { areas: Some(Default::default()), ..Report::default() };
        let scene = PageScene::new(&Default::default(), &mut &crate::surface::mesh::Mesh::default(), &[]);
        let page = page("a & b", &report, [0.0, 1.0], &scene.expect("memory can be read"), Some(0.2));
        assert!(page.contains("before it was simplified") && page.contains("up to 0.2 "));
        assert!(!page.contains("{{") && page.contains("<h1>a &amp; b</h1>"));
    }
}
