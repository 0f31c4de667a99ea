//! Names and colours of labels, as 3D Slicer's `.seg.nrrd` has them: `Segment0_LabelValue:=5`, `Segment0_Name:=femur`,
//! `Segment0_Color:=0.5 0.68 0.5`.

use std::collections::BTreeMap;

use crate::stack::appearance::Appearance;

/// The segments among the key/value pairs of a header, by label. What is no number, or no colour, names nothing.
pub(crate) fn read(pairs: &BTreeMap<String, String>) -> BTreeMap<i64, Appearance> {
    let of = |segment: &str, what: &str| pairs.get(&format!("{segment}_{what}"));
    let segments = pairs.iter().filter_map(|(key, value)| {
        let segment = key.strip_suffix("_LabelValue")?;
        let digits = segment.strip_prefix("Segment")?;
        if digits.is_empty() || digits.bytes().any(|b| !b.is_ascii_digit()) {
            return None;
        }
        let label = value.trim().parse().ok()?;
        let name = of(segment, "Name").map(|name| unescaped(name)).filter(|name| !name.is_empty());
        let colour = of(segment, "Color").and_then(|text| colour(text));
        Some((label, Appearance { name, number: Some(label), colour }))
    });
    segments.collect()
}

/// Three shares of 1.
fn colour(text: &str) -> Option<[u8; 3]> {
    let shares: Option<Vec<f64>> = text.split_whitespace().map(|t| t.parse().ok()).collect();
    let shares: [f64; 3] = shares?.try_into().ok()?;
    shares.iter().all(|v| (0.0..=1.0).contains(v)).then(|| shares.map(|v| (255.0 * v).round() as u8))
}

/// A value without NRRD's escapes for line ends and backslashes.
fn unescaped(value: &str) -> String {
    value.trim().replace("\\n", " ").replace("\\\\", "\\")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_names_nothing() {
        let pairs = [
            ("Segment0_LabelValue", "5"),
            ("Segment0_Name", " left\\nlung "),
            ("Segment0_Color", "0.5 1 0"),
            ("Segment1_LabelValue", "x"),
            ("Segment1_Name", "nobody"),
            ("Segment2_LabelValue", "-7"),
            ("Segment2_Color", "0.5 1 nan"),
            ("SegmentX_LabelValue", "9"),
            ("Segment10_Name", "without label"),
        ];
        let segments = read(&pairs.map(|(key, value)| (key.into(), value.into())).into());
        let lung = Appearance { name: Some("left lung".into()), number: Some(5), colour: Some([128, 255, 0]) };
        assert_eq!(segments, [(5, lung), (-7, Appearance::label(-7))].into());
    }
}
