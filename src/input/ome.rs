//! Description in a TIFF of its voxels: OME-XML, ImageJ's lines, or tifffile's shape.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::input::volume::grid::{Failure, TAKE_ONE};
use crate::surface::length::from_ome;

/// Findings in a description.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Described {
    /// The dialect, for people.
    pub format: &'static str,
    /// Voxel sides along x, y, z and their unit.
    pub spacing: Option<([f64; 3], String)>,
}

/// Reads the description of a TIFF with pages of `dims[0]` x `dims[1]` px and `dims[2]` pages; `per_unit` are the pixels per unit that its
/// first page tells.
pub(crate) fn describe(text: &str, dims: [usize; 3], per_unit: [Option<f64>; 2]) -> Failure<Described> {
    let text = text.trim_matches(['\0', ' ', '\n', '\r']);
    if text.contains("<OME") {
        Ok(Described { format: "OME-TIFF", spacing: ome(text, dims).map_err(|m| format!("OME-XML: {m}"))? })
    } else if text.starts_with("ImageJ=") {
        Ok(Described { format: "TIFF of ImageJ", spacing: imagej(text, dims[2], per_unit)? })
    } else {
        shape(text)?;
        Ok(Described { format: "TIFF", spacing: None })
    }
}

type Spacing = Option<([f64; 3], String)>;

fn ome(text: &str, dims: [usize; 3]) -> Failure<Spacing> {
    let mut reader = Reader::from_str(text);
    let mut spacing = None;
    let mut images = 0;
    let mut planes = 0;
    loop {
        match reader.read_event().map_err(|e| e.to_string())? {
            Event::Eof => break,
            Event::Start(tag) | Event::Empty(tag) => match tag.local_name().as_ref() {
                "Pixels" => {
                    images += 1;
                    if images > 1 {
                        return Err("has more than one image; save the one that is meant".into());
                    }
                    spacing = pixels(&tag, dims)?;
                }
                "TiffData" => {
                    let (page, z) = (attribute(&tag, "IFD")?, attribute(&tag, "FirstZ")?);
                    let number = |text: Option<String>| text.map(|t| t.trim().parse::<usize>());
                    if let (Some(page), z) = (number(page), number(z))
                        && page != z.unwrap_or(Ok(0))
                    {
                        return Err(format!("TiffData {planes}: pages are not in the order of z"));
                    }
                    planes += 1;
                }
                _ => {}
            },
            _ => {}
        }
    }
    if images == 0 { Err("has no Pixels".into()) } else { Ok(spacing) }
}

fn attribute(tag: &BytesStart<'_>, name: &str) -> Failure<Option<String>> {
    let found = tag.try_get_attribute(name).map_err(|e| e.to_string())?;
    Ok(found.map(|a| a.value.into_owned()))
}

/// The attributes of `Pixels`.
fn pixels(tag: &BytesStart<'_>, dims: [usize; 3]) -> Failure<Spacing> {
    let size = |name: &str| -> Failure<usize> {
        let text = attribute(tag, name)?.ok_or_else(|| format!("Pixels has no {name}"))?;
        text.trim().parse().map_err(|_| format!("{name} must be a whole number; got {text}"))
    };
    for (name, axis) in [("SizeC", "channel"), ("SizeT", "time")] {
        match size(name)? {
            1 => {}
            n => return Err(format!("{name} is {n}; a label volume has no {axis} axis: {TAKE_ONE}")),
        }
    }
    for (name, n) in ["SizeX", "SizeY", "SizeZ"].into_iter().zip(dims) {
        let said = size(name)?;
        if said != n {
            return Err(format!("{name} is {said}, but the file's pages make {n}"));
        }
    }
    let mut sides = [None; 3];
    for (slot, name) in sides.iter_mut().zip(["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"]) {
        let Some(text) = attribute(tag, name)? else { continue };
        let side = positive(name, &text)?;
        let unit = attribute(tag, &format!("{name}Unit"))?.unwrap_or("\u{b5}m".into());
        let metres = from_ome(&unit).ok_or_else(|| format!("{name}Unit `{unit}` is no known unit of length"))?;
        *slot = Some((side, metres));
    }
    match sides {
        [None, None, None] => Ok(None),
        [Some((x, metres)), Some((y, my)), Some((z, mz))] => {
            let sides = [x, y, z];
            let in_x = [metres.0, my.0, mz.0].map(|m| if m == metres.0 { 1.0 } else { m / metres.0 });
            Ok(Some((std::array::from_fn(|a| sides[a] * in_x[a]), metres.1.into())))
        }
        _ => Err("PhysicalSizeX, Y and Z must all be there, or none".into()),
    }
}

fn positive(name: &str, text: &str) -> Failure<f64> {
    let value = text.trim().parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| format!("{name} must be a positive number; got {text}"))
}

/// ImageJ's lines `name=value`. Pixels per unit stand in the TIFF's resolution.
fn imagej(text: &str, pages: usize, per_unit: [Option<f64>; 2]) -> Failure<Spacing> {
    let field = |name: &str| text.lines().find_map(|l| l.strip_prefix(name)?.strip_prefix('=')).map(str::trim);
    let fail = |message: String| Err(format!("ImageJ's description: {message}"));
    for (name, axis) in [("channels", "channel"), ("frames", "time")] {
        if let Some(n) = field(name).filter(|n| *n != "1") {
            return fail(format!("{name} is {n}; a label volume has no {axis} axis: {TAKE_ONE}"));
        }
    }
    for name in ["slices", "images"] {
        if let Some(n) = field(name).filter(|n| *n != pages.to_string()) {
            return fail(format!("{name} is {n}, but the file has {pages} pages"));
        }
    }
    let unit = field("unit").filter(|unit| !["", "pixel", "pixels"].contains(unit));
    // ImageJ writes no spacing where it is 1.
    let spacing = match (field("spacing"), unit, per_unit) {
        (Some(spacing), ..) => spacing,
        (None, Some(_), [Some(_), Some(_)]) => "1",
        _ => return Ok(None),
    };
    let dz = positive("spacing", spacing).map_err(|m| format!("ImageJ's description: {m}"))?;
    let [Some(x), Some(y)] = per_unit else {
        return fail(format!("spacing is {spacing}, but the page has no resolution"));
    };
    for (name, v) in [("XResolution", x), ("YResolution", y)] {
        if !(v.is_finite() && v > 0.0) {
            return fail(format!("{name} must be a positive number; got {v}"));
        }
    }
    let unit = unit.map_or("px", |unit| from_ome(unit).map_or(unit, |(_, name)| name));
    Ok(Some(([1.0 / x, 1.0 / y, dz], unit.into())))
}

/// tifffile's `{"shape": [9, 30, 40]}`.
fn shape(text: &str) -> Failure<()> {
    let value: Option<serde_json::Value> = serde_json::from_str(text).ok();
    let Some(shape) = value.as_ref().and_then(|v| v.get("shape")?.as_array()) else { return Ok(()) };
    let long = shape.iter().filter(|n| n.as_u64() != Some(1)).count();
    if long > 3 {
        let sizes: Vec<String> = shape.iter().map(ToString::to_string).collect();
        return Err(format!(
            "shape is [{}] in the description; a label volume has three axes: {TAKE_ONE}",
            sizes.join(", ")
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imagej_writes_no_depth_of_one_and_no_resolution_of_pixels() {
        let of = |text: &str, per_unit| imagej(text, 3, per_unit).expect("it is read");
        let quarter = [Some(4.0), Some(4.0)];
        assert_eq!(of("images=3\nunit=micron\n", quarter), Some(([0.25, 0.25, 1.0], "um".into())));
        assert_eq!(of("images=3\nspacing=2.0\nunit=micron\n", quarter), Some(([0.25, 0.25, 2.0], "um".into())));
        assert_eq!(of("images=3\nspacing=2.0\n", quarter), Some(([0.25, 0.25, 2.0], "px".into())));
        assert_eq!(of("images=3\nunit=micron\n", [None; 2]), None);
        assert_eq!(of("images=3\nunit=pixel\n", quarter), None);
        assert_eq!(of("images=3\n", quarter), None);
    }

    #[test]
    fn a_description_of_more_than_three_axes_is_refused() {
        for taken in
            ["{\"shape\": [9, 30, 40]}", "{\"shape\": [1, 9, 30, 40]}", "{\"shape\": [9, 1, 30, 40, 1]}", "text"]
        {
            assert!(shape(taken).is_ok(), "{taken}");
        }
        for refused in ["{\"shape\": [2, 9, 30, 40]}", "{\"shape\": [2, 9, 30, 40, 3]}"] {
            assert!(shape(refused).is_err(), "{refused}");
        }
    }
}
