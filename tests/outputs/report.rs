//! Numbers of a report and of what is written beside it: areas and ends, origin and confidence, the mesh of a .glb.

use std::fs;

use crate::files::folder;
use crate::written::{collected, cone, write};
use interslice::Settings;
use interslice::files::options::OutputOptions;
use interslice::report::BodyEnd;
use interslice::settings::EndRule;

#[test]
fn areas_and_ends_add_up_to_the_volume() {
    let place = folder();
    let stack = cone();
    let run = |rule: EndRule| {
        let settings = Settings { end_bottom: rule, end_top: rule, fair: 0.0, ..Settings::default() };
        write(place.path(), &stack, &settings, OutputOptions { dz: Some(0.1), ..Default::default() }, &["r.json"])
    };
    for rule in [EndRule::Flat, EndRule::HalfSlice, EndRule::Extrapolate, EndRule::Peak(14.0)] {
        let rule_is = rule.to_string();
        let settings = Settings { end_top: rule, fair: 0.0, ..Settings::default() };
        let report =
            write(place.path(), &stack, &settings, OutputOptions { dz: Some(0.1), ..Default::default() }, &["r.json"]);
        let areas = report.areas.expect("a report has them");
        let sum = areas.between_contours + report.ends.iter().map(|e| e.used).sum::<f64>();
        let volume = report.volume.expect("a report has it");
        println!("{rule_is}: {volume:.1}, by areas {sum:.1}, ends {:?}", report.ends);
        assert!((sum / volume - 1.0).abs() < 2e-3, "{rule_is}: {sum} for {volume}");
        assert_eq!(report.ends.iter().map(|e| e.side).collect::<Vec<_>>(), [BodyEnd::Bottom, BodyEnd::Top]);
        assert!(areas.layers.windows(2).all(|w| w[0][0] < w[1][0]), "heights increase");
    }
    // What a run says of rules that it does not use is what a run that uses them does.
    let [flat, half, extrapolated] = [EndRule::Flat, EndRule::HalfSlice, EndRule::Extrapolate].map(run);
    for k in 0..2 {
        assert_eq!(flat.ends[k].half_slice, half.ends[k].used);
        assert_eq!(flat.ends[k].extrapolate, extrapolated.ends[k].used);
        assert_eq!(flat.ends[k].used, 0.0);
    }
    // A cone with 15 to its tip; two gaps, 6, are the most: beginning with the cone's slope, -2 A / 15, the area is A (1 - q) (1 + 0.2 q).
    let tip = extrapolated.areas.and_then(|a| a.layers.last().copied()).expect("it has layers")[0];
    let exact = flat.ends[1].area * 6.0 * (4.0 - 0.8) / 6.0;
    println!("extrapolate: {} for {exact}", flat.ends[1].extrapolate);
    assert!((tip - 15.0).abs() < 1e-9 && (flat.ends[1].extrapolate / exact - 1.0).abs() < 0.02);
}

#[test]
fn origin_and_confidence_are_as_defined() {
    let place = folder();
    let stack = cone();
    let settings = Settings { end_top: EndRule::Extrapolate, ..Settings::default() };
    let names = ["a.origin.nrrd", "a.confidence.nii", "a.nrrd"];
    write(place.path(), &stack, &settings, OutputOptions::default(), &names);
    let body = collected(&stack, &settings);
    let origin = inflated(&fs::read(place.path().join(names[0])).expect("written"));
    let bytes = fs::read(place.path().join(names[1])).expect("written");
    let confidence: Vec<f32> = bytes[352..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let layers: Vec<_> = body.output_layers().collect();
    let n = stack.dims[0] * stack.dims[1];
    assert_eq!([origin.len(), confidence.len()], [n * layers.len(); 2]);
    let contour = |k: usize| &body.layers.iter().find(|l| l.contour == Some(k)).expect("a layer each").phi;
    let mut seen = [0usize; 4];
    for (layer, (origin, confidence)) in layers.iter().zip(origin.chunks(n).zip(confidence.chunks(n))) {
        let above = stack.slices.iter().position(|s| s.z >= layer.z).unwrap_or(3).max(1);
        let [low, high] = [stack.slices[above - 1].z, stack.slices[above].z];
        let t = (layer.z - low) / (high - low);
        let kind = if layer.contour.is_some() {
            1
        } else if t > 1.0 {
            3
        } else {
            2
        };
        for k in 0..n {
            let inside = layer.phi[k] < 0.0;
            assert_eq!(origin[k], if inside { kind } else { 0 }, "pixel {k} at {}", layer.z);
            seen[usize::from(origin[k])] += 1;
            let change = f64::from(contour(above)[k] - contour(above - 1)[k]).abs();
            let u = change * if kind == 3 { t - 1.0 } else { t * (1.0 - t) };
            let expected = match u > 0.0 {
                true => 1.0 - 0.5 / (1.0 + f64::from(layer.phi[k]).abs() / (0.63 * u)).powi(2),
                false => 1.0,
            };
            assert!((f64::from(confidence[k]) - expected).abs() < 1e-5, "pixel {k} at {}", layer.z);
        }
    }
    println!("voxels: {seen:?}");
    assert!(seen.iter().all(|count| *count > 100), "{seen:?}");
    assert!(confidence.iter().any(|p| *p < 0.6), "somewhere the surface is uncertain");
}

/// What is behind a NRRD's header.
fn inflated(bytes: &[u8]) -> Vec<u8> {
    let start = bytes.windows(2).position(|w| w == b"\n\n").expect("a header ends") + 2;
    let mut out = Vec::new();
    std::io::copy(&mut flate2::read::GzDecoder::new(&bytes[start..]), &mut out).expect("a gzip stream");
    out
}

#[test]
fn a_glb_holds_the_mesh() {
    use interslice::surface::mesh::closed_surface;
    let place = folder();
    let stack = cone();
    write(place.path(), &stack, &Settings::default(), OutputOptions::default(), &["left lung.glb"]);
    let mesh = closed_surface(&collected(&stack, &Settings::default()));
    let bytes = fs::read(place.path().join("left lung.glb")).expect("it was written");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let json = word(12);
    let root = gltf_json::Root::from_slice(&bytes[20..20 + json]).expect("it is glTF");
    let mut wrong = Vec::new();
    gltf_json::validation::Validate::validate(&root, &root, gltf_json::Path::new, &mut |path, error| {
        wrong.push((path().to_string(), error.to_string()));
    });
    assert!(wrong.is_empty(), "{wrong:?}");
    assert_eq!(root.meshes[0].name.as_deref(), Some("left lung"));
    let extras = root.meshes[0].extras.as_ref().expect("the unit is told").get();
    assert!(extras.contains(r#""unit":"#) && extras.contains("left-posterior-superior"), "{extras}");
    let data = &bytes[28 + json..];
    assert_eq!(word(20 + json), data.len());
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    assert_eq!(data.len(), 24 * vertices + 12 * triangles);
    for (p, b) in mesh.positions.iter().zip(data.as_chunks::<12>().0) {
        assert_eq!(p.as_vec3().to_array().map(f32::to_le_bytes).as_flattened(), b);
    }
    let corners = data[24 * vertices..].as_chunks::<12>().0;
    for (t, b) in mesh.triangles.iter().zip(corners) {
        assert_eq!(t.map(u32::to_le_bytes).as_flattened(), b);
    }
}
