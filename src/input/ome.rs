//! Description in a TIFF of its voxels: OME-XML, ImageJ's lines, or tifffile's shape.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::input::volume::Lacking;
use crate::input::volume::grid::{Failure, TAKE_ONE};
use crate::surface::length::from_ome;

/// Findings in a description.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Described {
    /// The dialect, for people.
    pub format: &'static str,
    /// Voxel sides along x, y, z and their unit.
    pub spacing: Spacing,
    /// The side that it does not have, though it has others.
    pub lacks: Option<Lacking>,
}

/// Voxel sides along x, y, z and their unit.
type Spacing = Option<([f64; 3], String)>;
/// What is known of them, and what the text lacks.
type Sides = (Spacing, Option<Lacking>);

/// Reads the description of a TIFF with pages of `dims[0]` x `dims[1]` px and `dims[2]` pages; `per_unit` are the pixels per unit that its
/// first page tells.
pub(crate) fn describe(text: &str, dims: [usize; 3], per_unit: [Option<f64>; 2]) -> Failure<Described> {
    let text = text.trim_matches(['\0', ' ', '\n', '\r']);
    if text.contains("<OME") {
        let (spacing, lacks) = ome(text, dims).map_err(|m| format!("OME-XML: {m}"))?;
        Ok(Described { format: "OME-TIFF", spacing, lacks })
    } else if text.starts_with("ImageJ=") {
        let (spacing, lacks) = imagej(text, dims[2], per_unit)?;
        Ok(Described { format: "TIFF of ImageJ", spacing, lacks })
    } else {
        shape(text)?;
        Ok(Described { format: "TIFF", spacing: None, lacks: None })
    }
}

fn ome(text: &str, dims: [usize; 3]) -> Failure<Sides> {
    let mut reader = Reader::from_str(text);
    let mut sides = (None, None);
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
                    sides = pixels(&tag, dims)?;
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
    if images == 0 { Err("has no Pixels".into()) } else { Ok(sides) }
}

fn attribute(tag: &BytesStart<'_>, name: &str) -> Failure<Option<String>> {
    let found = tag.try_get_attribute(name).map_err(|e| e.to_string())?;
    Ok(found.map(|a| a.value.into_owned()))
}

/// The attributes of `Pixels`.
fn pixels(tag: &BytesStart<'_>, dims: [usize; 3]) -> Failure<Sides> {
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
    let in_one = |sides: [(f64, (f64, &'static str)); 3]| {
        let unit = sides[0].1;
        let side =
            |(side, metres): (f64, (f64, &str))| if metres.0 == unit.0 { side } else { side * (metres.0 / unit.0) };
        Some((sides.map(side), unit.1.into()))
    };
    match sides {
        [None, None, None] => Ok((None, None)),
        [Some(x), Some(y), Some(z)] => Ok((in_one([x, y, z]), None)),
        [Some(x), Some(y), None] => {
            let spacing: Spacing = in_one([x, y, x]);
            let told = spacing.as_ref().map(|([x, y, _], unit)| {
                format!("has no PhysicalSizeZ, how far apart its slices are; say `--spacing` {x},{y},DZ ({unit})")
            });
            Ok((spacing, told.map(Lacking::Needed)))
        }
        _ => Err("PhysicalSizeX and Y must both be there, or none of X, Y and Z".into()),
    }
}

fn positive(name: &str, text: &str) -> Failure<f64> {
    let value = text.trim().parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| format!("{name} must be a positive number; got {text}"))
}

/// ImageJ's lines `name=value`. Pixels per unit stand in the TIFF's resolution.
fn imagej(text: &str, pages: usize, per_unit: [Option<f64>; 2]) -> Failure<Sides> {
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
    let (spacing, own) = match (field("spacing"), unit, per_unit) {
        (Some(spacing), ..) => (spacing, true),
        (None, Some(_), [Some(_), Some(_)]) => ("1", false),
        _ => return Ok((None, None)),
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
    let assumed = || {
        Lacking::Assumed(format!(
            "has no `spacing`: slices are 1 {unit} apart then, as ImageJ has it; `--spacing` says otherwise"
        ))
    };
    Ok((Some(([1.0 / x, 1.0 / y, dz], unit.into())), (!own).then(assumed)))
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
        let (spacing, lacks) = of("images=3\nunit=micron\n", quarter);
        assert_eq!(spacing, Some(([0.25, 0.25, 1.0], "um".into())));
        assert!(matches!(&lacks, Some(Lacking::Assumed(told)) if told.contains("1 um apart")), "{lacks:?}");
        let own = |unit: &str| (Some(([0.25, 0.25, 2.0], unit.into())), None);
        assert_eq!(of("images=3\nspacing=2.0\nunit=micron\n", quarter), own("um"));
        assert_eq!(of("images=3\nspacing=2.0\n", quarter), own("px"));
        assert_eq!(of("images=3\nunit=micron\n", [None; 2]), (None, None));
        assert_eq!(of("images=3\nunit=pixel\n", quarter), (None, None));
        assert_eq!(of("images=3\n", quarter), (None, None));
    }

    #[test]
    fn an_ome_tiff_may_lack_the_distance_of_its_slices_and_no_other_side() {
        let of = |sides: &str| {
            let pixels = format!(
                r#"<OME><Image><Pixels SizeX="9" SizeY="8" SizeZ="7" SizeC="1" SizeT="1" {sides}/></Image></OME>"#
            );
            describe(&pixels, [9, 8, 7], [None; 2])
        };
        let whole = of(r#"PhysicalSizeX="0.5" PhysicalSizeY="0.25" PhysicalSizeZ="2000" PhysicalSizeZUnit="nm""#);
        let whole = whole.expect("it has all sides");
        assert_eq!((whole.spacing, whole.lacks), (Some(([0.5, 0.25, 2.0], "um".into())), None));
        let flat = of(r#"PhysicalSizeX="0.5" PhysicalSizeY="0.25""#).expect("it has two sides");
        let told = "has no PhysicalSizeZ, how far apart its slices are; say `--spacing` 0.5,0.25,DZ (um)";
        assert_eq!(flat.lacks, Some(Lacking::Needed(told.into())));
        assert_eq!(of("").expect("it has none").spacing, None);
        for some in ["PhysicalSizeX", "PhysicalSizeZ"] {
            assert!(of(&format!(r#"{some}="0.5""#)).is_err(), "{some} alone");
        }
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
