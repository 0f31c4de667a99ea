//! Units of length by the names that inputs give them.

/// Names of a unit, and what 3MF calls it.
const UNITS: &[(&[&str], &str)] = &[
    (&["um", "\u{b5}m", "\u{3bc}m"], "micron"),
    (&["mm"], "millimeter"),
    (&["cm"], "centimeter"),
    (&["m"], "meter"),
    (&["in", "inch"], "inch"),
    (&["ft"], "foot"),
];

/// Name of a unit in 3MF, which knows six of them.
pub(super) fn of_3mf(name: &str) -> Option<&'static str> {
    UNITS.iter().find(|(names, _)| names.contains(&name.trim())).map(|(_, of_3mf)| *of_3mf)
}
