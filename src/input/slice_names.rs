//! What the names of a folder's slices tell of their order: numbers that are there twice, numbers that are missing, several series.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::path::Path;

use crate::error::counted;

/// Names of one series that come again in another.
const AGAIN: usize = 2;

/// Words where the names of slices are those of several series: in two parts of them the same numbers come again, beside another word (`a0`, `a1`, `b0`, `b1`)
/// or another number (`c0_z0`, `c0_z1`, `c1_z0`, `c1_z1`).
pub(super) fn series(names: &[&str]) -> Option<String> {
    let numbered: Vec<(String, Vec<u64>)> = names.iter().map(|name| numbers(name)).collect::<Option<_>>()?;
    let most = numbered.iter().map(|(_, own)| own.len()).max()?;
    let ways = std::iter::once(None).chain((0..most).map(Some));
    let series = ways.map(|at| largest(&numbered, at)).find(|series| match &series[..] {
        [first, second, ..] => {
            let again = second.iter().filter(|one| first.iter().any(|own| own.others == one.others)).count();
            again >= AGAIN && 2 * again >= second.len()
        }
        _ => false,
    })?;
    let range =
        |members: &[Member]| format!("`{}` to `{}`", names[members[0].name], names[members[members.len() - 1].name]);
    Some(format!(
        "the names are those of {} series ({}; {}): all are taken as slices of one stack; move what is another one out of the folder",
        series.len(),
        range(&series[0]),
        range(&series[1])
    ))
}

/// A name of a series: its place among all, and its numbers without the one that the series has in common.
struct Member {
    name: usize,
    others: Vec<u64>,
}

/// The names that have the same words around their numbers, or number `at` too, the most first; nothing where a name has no such number of its own.
fn largest(numbered: &[(String, Vec<u64>)], at: Option<usize>) -> Vec<Vec<Member>> {
    let mut series: BTreeMap<(&str, Option<u64>), Vec<Member>> = BTreeMap::new();
    for (name, (words, own)) in numbered.iter().enumerate() {
        let mut others = own.clone();
        let number = match at {
            Some(at) if at >= own.len() || is_of_decimal(words, at) => return Vec::new(),
            Some(at) => Some(others.remove(at)),
            None => None,
        };
        series.entry((words, number)).or_default().push(Member { name, others });
    }
    let mut series: Vec<Vec<Member>> = series.into_values().collect();
    series.sort_by_key(|members| (Reverse(members.len()), members[0].name));
    series
}

/// Words where the names of slices, in order, have a number twice, or one is another with something behind its number: a file may be a copy.
pub(super) fn repeats(names: &[&str]) -> Option<String> {
    let numbered: Vec<Option<(String, Vec<u64>)>> = names.iter().map(|name| numbers(name)).collect();
    let same =
        |k: usize| numbered[k].as_ref().is_some_and(|(_, own)| !own.is_empty()) && numbered[k] == numbered[k + 1];
    let alike = |k: &usize| same(*k) || is_more_of(names[*k], names[k + 1]) || is_more_of(names[k + 1], names[*k]);
    let places: Vec<usize> = (0..names.len().saturating_sub(1)).filter(alike).collect();
    let &k = places.first()?;
    let more = if places.len() > 1 {
        format!(" (and so at {} more)", counted(places.len() - 1, "place"))
    } else {
        String::new()
    };
    Some(format!(
        "`{}` and `{}` have the same number{more}: both are taken as slices, one above the other; if one is a copy, move it out of the folder",
        names[k],
        names[k + 1]
    ))
}

/// Whether a name is another one, that has a number, with something behind it, as a copy's is: `s02 copy.png`, `s02 (1).png`.
fn is_more_of(name: &str, other: &str) -> bool {
    let stem = |name| Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let (name, other) = (stem(name), stem(other));
    let more = name.strip_prefix(&other).and_then(|more| more.chars().next());
    // A point, a comma or a hyphen may belong to a number.
    other.ends_with(|c: char| c.is_ascii_digit()) && more.is_some_and(|c| c.is_alphabetic() || " _(".contains(c))
}

/// Words where the numbers in the names of slices, in order, leave some out, so that a file may be missing, or rise by unlike steps, so that they may be
/// heights.
pub(super) fn skips(names: &[&str]) -> Option<String> {
    let numbered: Vec<(String, Vec<u64>)> = names.iter().map(|name| numbers(name)).collect::<Option<_>>()?;
    let (template, first) = numbered.first()?;
    if numbered.iter().any(|(own, _)| own != template) {
        return None;
    }
    let varies = |at: &usize| numbered.iter().any(|(_, own)| own[*at] != first[*at]);
    let varying: Vec<usize> = (0..first.len()).filter(varies).collect();
    let [at] = varying[..] else { return None };
    let steps: Vec<u64> = numbered.windows(2).map(|w| w[1].1[at].saturating_sub(w[0].1[at])).collect();
    let mut often: BTreeMap<u64, usize> = BTreeMap::new();
    steps.iter().for_each(|step| *often.entry(*step).or_default() += 1);
    let usual = *often.iter().max_by_key(|(_, count)| **count)?.0;
    let longer: Vec<usize> = (0..steps.len()).filter(|&k| steps[k] > usual).collect();
    if 2 * longer.len() >= steps.len() || longer.is_empty() {
        let [least, most] = [steps.iter().min()?, steps.iter().max()?];
        return (least != most && *least > 0).then(|| {
            format!(
                "the numbers in the names rise by {least} to {most}, `{}` to `{}`: the slices are taken as equally far apart all the same; if the numbers \
                 are heights, write a stack.json with them",
                names[0],
                names[names.len() - 1]
            )
        });
    }
    let k = longer[0];
    let more =
        if longer.len() > 1 { format!(", and at {} more", counted(longer.len() - 1, "place")) } else { String::new() };
    Some(format!(
        "between `{}` and `{}` numbers are left out{more}: the slices are taken as equally far apart all the same; if one is missing, write a stack.json \
         with their heights",
        names[k],
        names[k + 1]
    ))
}

/// Whether number `at` of a name with these marks is a part of a decimal one.
fn is_of_decimal(template: &str, at: usize) -> bool {
    let marks: Vec<usize> = template.match_indices('#').map(|(place, _)| place).collect();
    let joined = |low: usize| {
        let between = marks.get(low).zip(marks.get(low + 1)).map(|(a, b)| &template[a + 1..*b]);
        between.is_some_and(|between| [".", ","].contains(&between))
    };
    joined(at) || at > 0 && joined(at - 1)
}

/// A name with a mark for every number in it, and these; nothing where one is too large.
fn numbers(name: &str) -> Option<(String, Vec<u64>)> {
    let (mut template, mut found) = (String::new(), Vec::new());
    let mut digits = String::new();
    for c in name.chars().map(Some).chain([None]) {
        match c {
            Some(c) if c.is_ascii_digit() => digits.push(c),
            c => {
                if !digits.is_empty() {
                    found.push(std::mem::take(&mut digits).parse().ok()?);
                    template.push('#');
                }
                template.extend(c);
            }
        }
    }
    Some((template, found))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_left_out_are_told() {
        for names in [
            &["s1.png", "s2.png", "s3.png"][..],
            &["v2_004.tif", "v2_008.tif", "v2_012.tif", "v2_016.tif"],
            &["z-2.5.png", "z-0.0.png", "z2.5.png"],
            &["a1.png", "b7.png", "b8.png", "b9.png"],
            &["s1.png"],
            &[],
            &["99999999999999999999.png", "99999999999999999999999.png"],
        ] {
            assert_eq!(skips(names), None, "{names:?}");
        }
        for names in [
            &["s1.png", "s2.png", "s10.png"][..],
            &["a1.png", "b1.png"],
            &["a.png", "b.png"],
            &["s1.png", "s1.tif"],
            &["z1.png", "z1.5.png", "z2.png", "z10.png"],
            &["mask.png", "mask copy.png"],
            &[],
        ] {
            assert_eq!(repeats(names), None, "{names:?}");
        }
        let told =
            repeats(&["m_0.png", "m_000.png", "m_1.png", "m_2.png", "m_002.png"]).expect("0 and 2 are there twice");
        assert!(told.starts_with("`m_0.png` and `m_000.png` have the same number (and so at 1 place more)"), "{told}");
        for copy in ["s2 copy.png", "s2 (1).png", "s2_old.png", "s2b.tif"] {
            let mut names = vec!["s1.png".to_string(), "s2.png".into(), copy.into(), "s3.png".into(), "s10.png".into()];
            crate::input::contents::sort_by_number(&mut names);
            let told = repeats(&names.iter().map(String::as_str).collect::<Vec<_>>()).unwrap_or_default();
            assert!(
                told.contains(copy) && told.contains("`s2.png`") && told.contains("same number:"),
                "{copy}: {told}"
            );
        }
        let told = skips(&["s1.png", "s2.png", "s4.png", "s5.png", "s6.png"]).expect("3 is missing");
        assert!(told.starts_with("between `s2.png` and `s4.png` numbers are left out: the slices"), "{told}");
        let names = ["a 0.tif", "a 5.tif", "a 15.tif", "a 20.tif", "a 25.tif", "a 30.tif", "a 40.tif", "a 45.tif"];
        let told = skips(&names).expect("10 and 35 are missing");
        assert!(
            told.starts_with("between `a 5.tif` and `a 15.tif` numbers are left out, and at 1 place more"),
            "{told}"
        );
    }

    #[test]
    fn numbers_that_rise_by_unlike_steps_are_told() {
        for (names, steps) in [
            (&["s1.png", "s4.png", "s9.png"][..], "rise by 3 to 5, `s1.png` to `s9.png`"),
            (&["z1.png", "z2.png", "z3.png", "z10.png", "z20.png"], "rise by 1 to 10, `z1.png` to `z20.png`"),
            (&["z0.tif", "z8.tif", "z16.tif", "z20.tif"], "rise by 4 to 8, `z0.tif` to `z20.tif`"),
        ] {
            let told = skips(names).unwrap_or_default();
            assert!(told.contains(steps), "{names:?}: {told}");
        }
    }

    #[test]
    fn several_series_are_told() {
        for names in [
            &["s1.png", "s2.png", "s3.png"][..],
            &["v2_004.tif", "v2_008.tif", "v2_012.tif"],
            &["z-2.5.png", "z-2.0.png", "z0.0.png", "z0.5.png"],
            &["a1.png", "a2.png", "b3.png", "b4.png"],
            &["2020-01-05.png", "2020-01-12.png", "2020-02-01.png"],
            &["s1_z10.png", "s2_z12.png", "s3_z14.png"],
            &["a.png", "b.png"],
            &["x0.png", "y0.png"],
            &["s1.png"],
            &[],
        ] {
            assert_eq!(series(names), None, "{names:?}");
        }
        for (names, told) in [
            (
                &["a0.png", "a1.png", "a2.png", "b0.png", "b1.png"][..],
                "2 series (`a0.png` to `a2.png`; `b0.png` to `b1.png`)",
            ),
            (
                &["c0_z0.png", "c0_z1.png", "c0_z2.png", "c1_z0.png", "c1_z1.png", "c1_z2.png"],
                "2 series (`c0_z0.png` to `c0_z2.png`; `c1_z0.png` to `c1_z2.png`)",
            ),
            (&["z0_c0.png", "z0_c1.png", "z1_c0.png", "z1_c1.png", "z2_c0.png", "z2_c1.png"], "series (`z0_c0.png` to"),
        ] {
            let found = series(names).unwrap_or_default();
            assert!(found.contains(told), "{names:?}: {found}");
        }
    }
}
