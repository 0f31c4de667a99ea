//! Facts in words and numbers, safe in HTML.

use crate::report::{ContourReport, Event, LinkReport, LinkedBy};

/// Text that is no markup.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Larger heights are told with four digits and a power of ten: a double has no more decimals than their gaps have digits.
const MOST_WRITTEN: f64 = 1e12;
const MOST_DECIMALS: f64 = 9.0;

/// A number with four digits that count, in groups of three.
pub fn number(v: f64) -> String {
    if !v.is_finite() {
        return "unknown".into();
    }
    if v == 0.0 {
        return "0".into();
    }
    let size = v.abs().log10().floor();
    if !(-4.0..7.0).contains(&size) {
        return powered(v);
    }
    grouped(v, (3.0 - size).max(0.0) as usize)
}

/// A height with as many decimals as four digits of `gap` have, so that heights this far apart differ.
pub fn height(z: f64, gap: f64) -> String {
    if !(gap > 0.0 && gap.is_finite() && z.abs() < MOST_WRITTEN) {
        return number(z);
    }
    grouped(z, (3.0 - gap.log10().floor()).clamp(0.0, MOST_DECIMALS) as usize)
}

/// The smallest gap of contours; infinite where there is none.
pub fn least_gap(contours: &[ContourReport]) -> f64 {
    contours.windows(2).map(|w| w[1].z - w[0].z).fold(f64::INFINITY, f64::min)
}

/// A number with so many decimals but for zeros at its end, in groups of three.
fn grouped(v: f64, decimals: usize) -> String {
    let text = format!("{v:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    let (whole, rest) = text.split_once('.').map_or((text, None), |(a, b)| (a, Some(b)));
    let (sign, digits) = whole.strip_prefix('-').map_or(("", whole), |d| ("\u{2212}", d));
    let sign = if digits == "0" && rest.is_none() { "" } else { sign };
    let mut grouped = String::from(sign);
    for (k, c) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(c);
    }
    rest.map_or(grouped.clone(), |rest| format!("{grouped}.{rest}"))
}

/// Four digits that count and a power of ten.
fn powered(v: f64) -> String {
    let text = format!("{v:.3e}");
    let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
    let digits = digits.trim_end_matches('0').trim_end_matches('.').replace('-', "\u{2212}");
    let raised = |c: char| match c {
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        '0' | '4'..='9' => char::from_u32('\u{2070}' as u32 + c as u32 - '0' as u32).unwrap_or(c),
        _ => '\u{207b}',
    };
    format!("{digits}\u{d7}10{}", power.chars().map(raised).collect::<String>())
}

/// A count in groups of three.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (k, c) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// Parts by their numbers, runs of more than two as ranges.
fn parts(numbers: &[usize]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &n in numbers {
        match runs.last_mut() {
            Some(run) if run[1] + 1 == n => run[1] = n,
            _ => runs.push([n, n]),
        }
    }
    let told = runs.into_iter().flat_map(|[a, b]| match b - a {
        0 => vec![a.to_string()],
        1 => vec![a.to_string(), b.to_string()],
        _ => vec![format!("{a} to {b}")],
    });
    let told: Vec<String> = told.collect();
    match told.split_last() {
        None => "no part".into(),
        Some((one, [])) if numbers.len() == 1 => format!("part {one}"),
        Some((one, [])) => format!("parts {one}"),
        Some((last, others)) => format!("parts {} and {last}", others.join(", ")),
    }
}

fn capital(text: String) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |c| c.to_uppercase().chain(chars).collect())
}

/// The changes of topology of an interval as sentences, going up; parts that begin or end and holes are told together.
pub fn events(events: &[Event]) -> Vec<String> {
    let (mut out, mut born, mut dead, mut opened, mut closed) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for event in events {
        match event {
            Event::Split { from, to } => out.push(becomes(from, "split", to)),
            Event::Merge { from, to } => out.push(becomes(from, "merge", to)),
            Event::Birth { component } => born.push(*component),
            Event::Death { component } => dead.push(*component),
            Event::HoleBirth { pixels } => opened.push(*pixels),
            Event::HoleDeath { pixels } => closed.push(*pixels),
        }
    }
    let verb = |numbers: &[usize], verb: &str| if numbers.len() == 1 { format!("{verb}s") } else { verb.into() };
    if !born.is_empty() {
        let of = format!("{} of the upper contour {} here", parts(&born), verb(&born, "begin"));
        out.push(capital(of + ": nothing below meets " + if born.len() == 1 { "it." } else { "them." }));
    }
    if !dead.is_empty() {
        let of = format!("{} of the lower contour {} here", parts(&dead), verb(&dead, "end"));
        out.push(capital(of + ": nothing above meets " + if dead.len() == 1 { "it." } else { "them." }));
    }
    out.extend(holes(&opened, "open", "upper"));
    out.extend(holes(&closed, "close", "lower"));
    out
}

fn becomes(from: &[usize], verb: &str, to: &[usize]) -> String {
    capital(format!("{} {verb}{} into {} above.", parts(from), if from.len() == 1 { "s" } else { "" }, parts(to)))
}

fn holes(pixels: &[usize], verb: &str, contour: &str) -> Option<String> {
    let (least, most) = (pixels.iter().min()?, pixels.iter().max()?);
    let size = match (least == most, *most) {
        (true, 1) => "1 pixel".into(),
        (true, n) => format!("{} pixels", count(n as u64)),
        (false, n) => format!("{} to {} pixels", count(*least as u64), count(n as u64)),
    };
    Some(match pixels.len() {
        1 => format!("A hole {verb}s ({size} in the {contour} contour)."),
        n => format!("{n} holes {verb} (of {size} in the {contour} contour)."),
    })
}

/// A link as a sentence.
pub fn link(link: &LinkReport) -> String {
    let LinkReport { from, to, join, by, meet } = link;
    let by = match by {
        LinkedBy::File => "as the links file says",
        LinkedBy::Auto => "found by the program",
        LinkedBy::Motion => "as the slit between them moves",
    };
    let what = if *join { "are joined" } else { "are kept apart" };
    format!(
        "Part {from} below and part {to} above {what}, {by}; they share {} % of their pixels.",
        number(100.0 * meet)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_no_markup() {
        assert_eq!(
            escape("<script>alert('1')</script>&\"\n"),
            "&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&amp;&quot; "
        );
    }

    #[test]
    fn numbers_have_four_digits_that_count() {
        let told = [0.0, 1234567.0, 12.3456, -0.00123456, 0.5, f64::NAN].map(number);
        assert_eq!(told, ["0", "1\u{202f}234\u{202f}567", "12.35", "\u{2212}0.001235", "0.5", "unknown"]);
        assert_eq!(
            [1.0e-9, -195_314_458_394.4].map(number),
            ["1\u{d7}10\u{207b}\u{2079}", "\u{2212}1.953\u{d7}10\u{b9}\u{b9}"]
        );
        assert_eq!(count(1000), "1\u{202f}000");
    }

    #[test]
    fn heights_have_the_digits_of_their_gaps() {
        let told = [-1203.25, -1202.75, 0.0, -0.0001, 1e13].map(|z| height(z, 0.5));
        assert_eq!(
            told,
            ["\u{2212}1\u{202f}203.25", "\u{2212}1\u{202f}202.75", "0", "\u{2212}0.0001", "1\u{d7}10\u{b9}\u{b3}"]
        );
        assert_eq!(
            [height(330.0, 20.0), height(4_000_000.37, 0.37), height(-0.001, 5.0)],
            ["330", "4\u{202f}000\u{202f}000.37", "\u{2212}0.001"]
        );
        assert_eq!([height(-0.0004, 5.0), height(1.23456, f64::INFINITY)], ["0", "1.235"]);
    }

    #[test]
    fn events_are_sentences() {
        let told = events(&[
            Event::Split { from: vec![1], to: vec![1, 2, 4, 5, 6, 7] },
            Event::Merge { from: vec![1, 2], to: vec![1] },
            Event::Death { component: 3 },
            Event::HoleBirth { pixels: 7 },
            Event::HoleBirth { pixels: 12 },
            Event::HoleDeath { pixels: 1 },
        ]);
        assert_eq!(
            told,
            [
                "Part 1 splits into parts 1, 2 and 4 to 7 above.",
                "Parts 1 and 2 merge into part 1 above.",
                "Part 3 of the lower contour ends here: nothing above meets it.",
                "2 holes open (of 7 to 12 pixels in the upper contour).",
                "A hole closes (1 pixel in the lower contour).",
            ]
        );
    }
}
