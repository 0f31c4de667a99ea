//! Elevation of lines: which attribute has it, and what it says.

use serde_json::Value;

use super::Feature;

type Parse<T> = Result<T, String>;

/// Names of elevation attributes, in any case; so are all that begin with "elev".
const NAMES: [&str; 7] = ["ele", "height", "contour", "contourelevation", "z", "altitude", "alt"];
/// Names that stand for the elevation where none of those is there: other words for it, and other languages'.
const OTHERS: [&str; 15] = [
    "hgt",
    "level",
    "lev",
    "value",
    "zvalue",
    "z_value",
    "contourele",
    "isohypse",
    "hoehe",
    "h\u{f6}he",
    "kote",
    "quota",
    "cota",
    "altitud",
    "hoogte",
];
/// Ends of the names of a band's elevations.
const LEAST: &str = "min";
const MOST: &str = "max";
/// Heights of a line's points this close, of their size, are one.
const SAME: f64 = 1e-9;

/// Ends of an attribute's name that say its unit, and metres of that.
const UNITS: [(&[&str], f64); 2] =
    [(&["_ft", " ft", "-ft", "(ft)", "feet"], 0.3048), (&["_m", " m", "-m", "(m)", "metres", "meters"], 1.0)];

/// Metres of the unit that an attribute's name says.
pub fn metres_of(field: &str) -> Option<f64> {
    let name = field.trim_end_matches('`').to_lowercase();
    UNITS.iter().find(|(ends, _)| ends.iter().any(|end| name.ends_with(end))).map(|(_, metres)| *metres)
}

/// A name in lower case without the unit at its end.
fn without_unit(name: &str) -> &str {
    let short = UNITS.iter().flat_map(|(ends, _)| *ends).find_map(|end| name.strip_suffix(end));
    short.map_or(name, |short| short.trim_end_matches(['_', ' ', '-']))
}

/// Source of elevations.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ElevationSource {
    /// In an attribute.
    Field(String),
    /// In the points' z.
    Points,
}

/// The attribute that is asked for, else the only one with a known name, else the points' z.
///
/// # Errors
/// A message with the names that there are.
pub fn source(features: &[Feature], asked: Option<&str>) -> Parse<ElevationSource> {
    let mut names: Vec<&str> = features.iter().flat_map(|f| f.fields.iter().map(|(name, _)| name.as_str())).collect();
    names.sort_unstable();
    names.dedup();
    let listed = || if names.is_empty() { "none".into() } else { format!("`{}`", names.join("`, `")) };
    if let Some(asked) = asked {
        let exact = names.iter().find(|n| **n == asked);
        let found = exact.or_else(|| names.iter().find(|n| n.eq_ignore_ascii_case(asked)));
        let none = || format!("`elevation` must name an attribute of the file; got `{asked}`, there are {}", listed());
        return found.map(|n| ElevationSource::Field((*n).into())).ok_or_else(none);
    }
    let known = |name: &str| {
        let name = name.to_lowercase();
        NAMES.contains(&without_unit(&name)) || name.starts_with("elev")
    };
    let mut found: Vec<&str> = names.iter().copied().filter(|n| known(n)).collect();
    if found.is_empty() && features.iter().flat_map(|f| &f.lines).all(|l| l.z.is_empty()) {
        found = names.iter().copied().filter(|n| OTHERS.contains(&without_unit(&n.to_lowercase()))).collect();
    }
    match found[..] {
        [only] => Ok(ElevationSource::Field(only.into())),
        [] if features.iter().flat_map(|f| &f.lines).any(|l| !l.z.is_empty()) => Ok(ElevationSource::Points),
        [] => Err(format!(
            "no attribute is known to be the elevation (elev..., height, contour, ..., level, z, ...) and points have no z; --elevation FIELD names \
             it; there are {}",
            listed()
        )),
        _ if features.iter().flat_map(|f| &f.lines).all(|l| l.ring)
            && [LEAST, MOST].iter().all(|end| has_one(&found, end)) =>
        {
            Err(format!(
                "its polygons lie between two elevations (`{}`); contour lines are needed, each at one: GDAL and QGIS make them where polygons \
                 are not asked for",
                found.join("`, `")
            ))
        }
        _ => Err(format!(
            "several attributes could be the elevation: `{}`; --elevation FIELD names it",
            found.join("`, `")
        )),
    }
}

/// Whether one of the names, in any case, ends so.
fn has_one(names: &[&str], end: &str) -> bool {
    names.iter().any(|name| name.to_lowercase().ends_with(end))
}

/// The elevation of line `part` of a feature; none where its attribute is null, blank or not there.
///
/// # Errors
/// A message with feature, attribute and value.
pub fn elevation(feature: &Feature, part: usize, source: &ElevationSource) -> Parse<Option<f64>> {
    let name = &feature.name;
    match source {
        ElevationSource::Field(field) => {
            let value = feature.fields.iter().find(|(n, _)| n == field).map_or(&Value::Null, |(_, v)| v);
            let number = match value {
                Value::Null => return Ok(None),
                Value::String(text) if text.trim().is_empty() => return Ok(None),
                Value::Number(n) => n.as_f64(),
                Value::String(text) => text.trim().parse().ok(),
                _ => None,
            };
            let wrong = || format!("{name}: `{field}` is {value}; it must be a finite number");
            number.filter(|v: &f64| v.is_finite()).map(Some).ok_or_else(wrong)
        }
        ElevationSource::Points => {
            let z = &feature.lines[part].z;
            let (low, high) = z.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
            match z.first() {
                None => Err(format!("{name}: its points have no z, and no attribute is the elevation")),
                Some(_) if !z.iter().all(|v| v.is_finite()) => {
                    Err(format!("{name}: z of a point is not a finite number"))
                }
                Some(first) if high - low <= SAME * first.abs().max(1.0) => Ok(Some(*first)),
                Some(_) => Err(format!("{name}: its points lie at {low} to {high}; a contour line has one height")),
            }
        }
    }
}
