//! Units of length by the names that inputs give them.

/// A unit.
struct Unit {
    names: &'static [&'static str],
    of_3mf: &'static str,
    metres: f64,
}

const UNITS: &[Unit] = &[
    Unit { names: &["um", "\u{b5}m", "\u{3bc}m"], of_3mf: "micron", metres: 1e-6 },
    Unit { names: &["mm"], of_3mf: "millimeter", metres: 1e-3 },
    Unit { names: &["cm"], of_3mf: "centimeter", metres: 1e-2 },
    Unit { names: &["m"], of_3mf: "meter", metres: 1.0 },
    Unit { names: &["in", "inch"], of_3mf: "inch", metres: 0.0254 },
    Unit { names: &["ft"], of_3mf: "foot", metres: 0.3048 },
    // 2e-6 longer than the foot that 3MF knows.
    Unit { names: &["us-ft"], of_3mf: "foot", metres: 1200.0 / 3937.0 },
];

fn of(name: &str) -> Option<&'static Unit> {
    UNITS.iter().find(|unit| unit.names.contains(&name.trim()))
}

/// The name of a unit for formats that hold plain letters: `um` for micrometres, however they are written.
pub(super) fn plain(name: &str) -> String {
    let known = of(name).map_or(name.trim(), |unit| unit.names[0]);
    known.replace(['"', '\n', '\r'], " ")
}

/// Name of a unit in 3MF, which knows six of them.
pub(super) fn of_3mf(name: &str) -> Option<&'static str> {
    of(name).map(|unit| unit.of_3mf)
}

/// Metres of a unit.
pub(crate) fn metres(name: &str) -> Option<f64> {
    of(name).map(|unit| unit.metres)
}

/// Name of the unit of so many metres.
#[cfg(feature = "terrain")]
pub(crate) fn named(metres: f64) -> String {
    let known = UNITS.iter().find(|unit| (unit.metres - metres).abs() < 1e-8 * metres);
    known.map_or_else(|| format!("{metres} m"), |unit| unit.names[0].into())
}

/// Units that OME has as well: the names by which the project knows them, the first its own, and OME's (`UnitsLength`), the symbol first; metres.
const OME: &[(&[&str], &[&str], f64)] = &[
    (&["nm"], &["nm", "nanometer"], 1e-9),
    (
        &["um", "\u{b5}m", "\u{3bc}m"],
        &["\u{b5}m", "\u{3bc}m", "um", "micron", "microns", "micrometer", "\\u00B5m", "&#181;m", "&#xB5;m"],
        1e-6,
    ),
    (&["mm"], &["mm", "millimeter"], 1e-3),
    (&["cm"], &["cm", "centimeter"], 1e-2),
    (&["m"], &["m", "meter"], 1.0),
    (&["km"], &["km", "kilometer"], 1e3),
    (&["inch", "in"], &["in", "inch"], 0.0254),
    (&["ft"], &["ft", "foot", "feet"], 0.3048),
];

/// OME's symbol of a unit.
pub(super) fn of_ome(name: &str) -> Option<&'static str> {
    OME.iter().find(|(own, ..)| own.contains(&name.trim())).map(|(_, symbols, _)| symbols[0])
}

/// Metres of a unit that OME-XML or ImageJ names, and what the program calls it.
pub(crate) fn from_ome(symbol: &str) -> Option<(f64, &'static str)> {
    let known = OME.iter().find(|(_, symbols, _)| symbols.contains(&symbol.trim()));
    known.map(|(own, _, metres)| (*metres, own[0]))
}

/// Note for a person about the unit that 3MF has for a survey foot.
pub(super) fn foot_of_3mf(name: &str) -> Option<String> {
    (name.trim() == "us-ft")
        .then(|| "3MF does not know the unit us-ft: it is written as foot, which is 2e-6 shorter".into())
}

/// Units with a length, for a person.
pub(super) fn known() -> String {
    UNITS.iter().map(|unit| unit.names[0]).collect::<Vec<_>>().join(", ")
}
