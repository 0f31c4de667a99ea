//! Facts in words and numbers, safe in HTML.

use crate::report::{Event, LinkReport, LinkedBy};

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

/// A number with four digits that count, in groups of three.
pub fn number(v: f64) -> String {
    if !v.is_finite() {
        return "unknown".into();
    }
    if v == 0.0 {
        return "0".into();
    }
    let size = v.abs().log10().floor();
    if !(-4.0..15.0).contains(&size) {
        return format!("{v:.3e}");
    }
    let decimals = (3.0 - size).max(0.0) as usize;
    let text = format!("{v:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    let (whole, rest) = text.split_once('.').map_or((text, None), |(a, b)| (a, Some(b)));
    let (sign, digits) = whole.strip_prefix('-').map_or(("", whole), |d| ("\u{2212}", d));
    let mut grouped = String::from(sign);
    for (k, c) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k) % 3 == 0 {
            grouped.push('\u{202f}');
        }
        grouped.push(c);
    }
    rest.map_or(grouped.clone(), |rest| format!("{grouped}.{rest}"))
}

/// A count in groups of three.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (k, c) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k) % 3 == 0 {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

fn parts(numbers: &[usize]) -> String {
    let told: Vec<String> = numbers.iter().map(usize::to_string).collect();
    match told.split_last() {
        None => "no part".into(),
        Some((one, [])) => format!("part {one}"),
        Some((last, others)) => format!("parts {} and {last}", others.join(", ")),
    }
}

fn capital(text: String) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |c| c.to_uppercase().chain(chars).collect())
}

/// A change of topology as a sentence, going up.
pub fn event(event: &Event) -> String {
    let verb = |numbers: &[usize], one: &str, many: &str| if numbers.len() == 1 { one.into() } else { String::from(many) };
    let pixels = |n: usize| format!("{} {}", count(n as u64), if n == 1 { "pixel" } else { "pixels" });
    match event {
        Event::Split { from, to } => {
            capital(format!("{} {} into {} above.", parts(from), verb(from, "splits", "split"), parts(to)))
        }
        Event::Merge { from, to } => {
            capital(format!("{} {} into {} above.", parts(from), verb(from, "merges", "merge"), parts(to)))
        }
        Event::Birth { component } => format!("Part {component} of the upper contour begins here: nothing below it meets it."),
        Event::Death { component } => format!("Part {component} of the lower contour ends here: nothing above it meets it."),
        Event::HoleBirth { pixels: n } => format!("A hole opens ({} in the upper contour).", pixels(*n)),
        Event::HoleDeath { pixels: n } => format!("A hole closes ({} in the lower contour).", pixels(*n)),
    }
}

/// A link as a sentence.
pub fn link(link: &LinkReport) -> String {
    let LinkReport { from, to, join, by, meet } = link;
    let by = match by {
        LinkedBy::File => "as the links file says",
        LinkedBy::Auto => "found by the program",
    };
    let what = if *join { "are joined" } else { "are kept apart" };
    format!("Part {from} below and part {to} above {what}, {by}; they share {} % of their pixels.", number(100.0 * meet))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_no_markup() {
        assert_eq!(escape("<script>alert('1')</script>&\"\n"), "&lt;script&gt;alert(&#39;1&#39;)&lt;/script&gt;&amp;&quot; ");
    }

    #[test]
    fn numbers_have_four_digits_that_count() {
        let told = [0.0, 1234567.0, 12.3456, -0.00123456, 0.5, f64::NAN].map(number);
        assert_eq!(told, ["0", "1\u{202f}234\u{202f}567", "12.35", "\u{2212}0.001235", "0.5", "unknown"]);
        assert_eq!(number(1.0e-9), "1.000e-9");
        assert_eq!(count(1000), "1\u{202f}000");
    }

    #[test]
    fn events_are_sentences() {
        let split = Event::Split { from: vec![1], to: vec![1, 2, 4] };
        assert_eq!(event(&split), "Part 1 splits into parts 1, 2 and 4 above.");
        let merge = Event::Merge { from: vec![1, 2], to: vec![1] };
        assert_eq!(event(&merge), "Parts 1 and 2 merge into part 1 above.");
    }
}
