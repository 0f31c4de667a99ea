//! What the EPSG registry of IOGP says of its codes (version 11.022, codes below 32767): which systems have degrees, and of what compound ones consist.

use std::sync::LazyLock;

/// Codes of geographic systems, which have degrees, two or three axes: first and last of each stretch.
const GEOGRAPHIC: &str = include_str!("geographic.txt");
/// Codes of systems that are compounds, of their systems of the plane, and of their systems of heights.
const COMPOUND: &str = include_str!("compound.txt");
/// Systems of heights in feet, and in those of the US survey.
const FEET: [u32; 9] = [5614, 6130, 6131, 6132, 8050, 8051, 8228, 8897, 5754];
const US_SURVEY_FEET: [u32; 6] = [5702, 6358, 6359, 6360, 8052, 8053];
/// Metres of both, and of the foot of 5754, which is that of Ireland before 1975 (Poolbeg).
const FOOT: f64 = 0.3048;
const US_SURVEY_FOOT: f64 = 1200.0 / 3937.0;
const POOLBEG: u32 = 5754;
const BRITISH_FOOT: f64 = 0.3048007491;

/// Whether a system's coordinates are degrees.
pub(super) fn is_geographic(code: u32) -> bool {
    static STRETCHES: LazyLock<Vec<[u32; 2]>> = LazyLock::new(|| {
        let stretch = |word: &str| {
            let (first, last) = word.split_once('-').unwrap_or((word, word));
            Some([first.parse().ok()?, last.parse().ok()?])
        };
        GEOGRAPHIC.split_whitespace().filter_map(stretch).collect()
    });
    let above = STRETCHES.partition_point(|[first, _]| *first <= code);
    above.checked_sub(1).is_some_and(|k| code <= STRETCHES[k][1])
}

/// The systems of the plane and of heights that a compound one consists of.
pub(super) fn parts(code: u32) -> Option<[u32; 2]> {
    static COMPOUNDS: LazyLock<Vec<[u32; 3]>> = LazyLock::new(|| {
        let row = |line: &str| {
            let mut numbers = line.split(' ').map(str::parse);
            Some([numbers.next()?.ok()?, numbers.next()?.ok()?, numbers.next()?.ok()?])
        };
        COMPOUND.lines().filter_map(row).collect()
    });
    let at = COMPOUNDS.binary_search_by_key(&code, |[compound, ..]| *compound).ok()?;
    let [_, plane, heights] = COMPOUNDS[at];
    Some([plane, heights])
}

/// Metres of the unit of a system of heights.
pub(super) fn metres_of_heights(code: u32) -> f64 {
    match code {
        POOLBEG => BRITISH_FOOT,
        _ if FEET.contains(&code) => FOOT,
        _ if US_SURVEY_FEET.contains(&code) => US_SURVEY_FOOT,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_are_known_by_their_codes() {
        for code in [3819, 4152, 4258, 4269, 4326, 4490, 4759, 4979, 6318, 7844, 9000] {
            assert!(is_geographic(code), "{code}");
        }
        for code in [0, 1024, 2154, 3857, 4978, 5773, 9707, 25833, 32633, 32766, u32::MAX] {
            assert!(!is_geographic(code), "{code}");
        }
    }

    #[test]
    fn compounds_are_two_systems_each() {
        for (code, wanted) in [
            (3901, Some([2393, 5717])),
            (5698, Some([2154, 5720])),
            (5973, Some([25833, 5941])),
            (9707, Some([4326, 5773])),
            (7415, Some([28992, 5709])),
            (25833, None),
            (5773, None),
            (0, None),
        ] {
            assert_eq!(parts(code), wanted, "{code}");
        }
        assert_eq!(COMPOUND.lines().count(), 449);
        let all = COMPOUND.lines().map(|line| line.split(' ').filter_map(|n| n.parse().ok()).collect::<Vec<u32>>());
        assert!(all.clone().all(|row| row.len() == 3 && parts(row[0]) == Some([row[1], row[2]])));
        assert!(all.clone().all(|row| parts(row[1]).is_none()), "a plane is no compound");
        assert!([8052, 6360].iter().all(|c| metres_of_heights(*c) == US_SURVEY_FOOT));
        assert_eq!([8228, 5773].map(metres_of_heights), [FOOT, 1.0]);
    }
}
