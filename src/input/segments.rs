//! Names and colours of labels, as 3D Slicer's `.seg.nrrd` has them: `Segment0_LabelValue:=5`, `Segment0_Name:=femur`,
//! `Segment0_Color:=0.5 0.68 0.5`.

use std::collections::BTreeMap;

use crate::input::volume::Layers;
use crate::input::volume::grid::Failure;
use crate::stack::appearance::{Appearance, Segment};

/// Most layers and segments of a file.
const MOST_LAYERS: usize = 4096;
const MOST_SEGMENTS: usize = 4096;

/// The segments among the key/value pairs of a header, by label. What is no number, or no colour, names nothing.
pub(crate) fn read(pairs: &BTreeMap<String, String>) -> BTreeMap<i64, Appearance> {
    let segments = pairs.iter().filter_map(|(key, value)| {
        let segment = key.strip_suffix("_LabelValue")?;
        let digits = segment.strip_prefix("Segment")?;
        if digits.is_empty() || digits.bytes().any(|b| !b.is_ascii_digit()) {
            return None;
        }
        let label = value.trim().parse().ok()?;
        Some((label, appearance(pairs, segment, label)))
    });
    segments.collect()
}

/// What the pairs say of the segment with this prefix.
fn appearance(pairs: &BTreeMap<String, String>, segment: &str, label: i64) -> Appearance {
    let text = |what: &str| {
        let value = pairs.get(&format!("{segment}_{what}")).map(|value| unescaped(value));
        value.filter(|value| !value.is_empty())
    };
    let known = Segment { id: text("ID"), tags: text("Tags").filter(|tags| tags != "|") };
    Appearance {
        name: text("Name"),
        number: Some(label),
        colour: text("Color").and_then(|text| colour(&text)),
        segment: Some(known).filter(|known| *known != Segment::default()),
    }
}

/// Whether a header has segments.
pub(crate) fn any(pairs: &BTreeMap<String, String>) -> bool {
    !numbered(pairs).is_empty()
}

/// Numbers of the segments, in their order.
fn numbered(pairs: &BTreeMap<String, String>) -> Vec<usize> {
    let number = |key: &String| key.strip_prefix("Segment")?.strip_suffix("_LabelValue")?.parse().ok();
    let mut numbers: Vec<usize> = pairs.keys().filter_map(number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Segments that may overlap, in `count` layers.
///
/// # Errors
/// A message with segment and value.
pub(crate) fn layers(pairs: &BTreeMap<String, String>, count: usize) -> Failure<Layers> {
    if !(1..=MOST_LAYERS).contains(&count) {
        return Err(format!("sizes begins with {count} layers of segments; there must be 1 to {MOST_LAYERS}"));
    }
    let segment = |k: usize| {
        let number = |what: &str| {
            let text = pairs.get(&format!("Segment{k}_{what}")).map_or("", |text| text.trim());
            text.parse::<i64>().map_err(|_| format!("Segment{k}_{what} must be a whole number; got `{text}`"))
        };
        let (layer, value) = (number("Layer")?, number("LabelValue")?);
        let place = usize::try_from(layer).ok().filter(|layer| *layer < count);
        let place = place.ok_or_else(|| format!("Segment{k}_Layer is {layer}, but there are {count} layers"))?;
        if value == 0 { Err(format!("Segment{k}_LabelValue is 0, the background")) } else { Ok((place, value)) }
    };
    let segments = numbered(pairs).into_iter().map(segment).collect::<Failure<Vec<_>>>()?;
    if segments.len() > MOST_SEGMENTS {
        return Err(format!("has {} segments; at most {MOST_SEGMENTS}", segments.len()));
    }
    Ok(Layers { count, segments, only: None })
}

/// The segments of [`layers`] by label: their places, from 1 on, for values are told apart in a layer only.
pub(crate) fn in_order(pairs: &BTreeMap<String, String>) -> BTreeMap<i64, Appearance> {
    let segment = |(label, k): (i64, usize)| (label, appearance(pairs, &format!("Segment{k}"), label));
    (1..).zip(numbered(pairs)).map(segment).collect()
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
            ("Segment0_ID", "Segment_12"),
            ("Segment0_Tags", "|"),
            ("Segment1_LabelValue", "x"),
            ("Segment1_Name", "nobody"),
            ("Segment2_LabelValue", "-7"),
            ("Segment2_Color", "0.5 1 nan"),
            ("SegmentX_LabelValue", "9"),
            ("Segment10_Name", "without label"),
        ];
        let segments = read(&pairs.map(|(key, value)| (key.into(), value.into())).into());
        let segment = Some(Segment { id: Some("Segment_12".into()), tags: None });
        let lung = Appearance { name: Some("left lung".into()), number: Some(5), colour: Some([128, 255, 0]), segment };
        assert_eq!(segments, [(5, lung), (-7, Appearance::label(-7))].into());
    }
}
