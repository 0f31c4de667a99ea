//! Coordinate systems: degrees that become lengths, and systems that contradict each other.

use std::fs;

use interslice::stack::ReadOptions;
use interslice::surface::map::Crs;
use interslice::terrain::Terrain;
use serde_json::Value;

use super::maps::*;
use crate::files::{folder, interslice, sound_stack, stderr};

/// Degrees of latitude and longitude about (-84.2, 36.3) of metres to the east and north, nearly.
fn degrees([x, y]: [f64; 2]) -> [f64; 2] {
    [-84.2 + x / 89_800.0, 36.3 + y / 111_000.0]
}

fn in_degrees(line: &Line) -> Line {
    line.iter().map(|p| degrees([p[0] - EAST, p[1] - NORTH])).collect()
}

#[test]
fn degrees_are_reprojected() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let rings = [(100, 4000.0), (150, 3000.0), (200, 2000.0)];
    let features: Vec<Value> = rings.iter().map(|(z, r)| feature(*z, &in_degrees(&circle([0.0, 0.0], *r)))).collect();
    // GeoJSON that names no system has longitude and latitude.
    let named = [
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "EPSG:4326",
        "EPSG:9707",
        "EPSG:4759",
        "urn:ogc:def:crs,crs:EPSG::4326,crs:EPSG::5773",
        "EPSG:4269",
    ];
    for crs in named.map(Some).into_iter().chain([None, Some("EPSG:4269")]) {
        fs::write(&path, collection(crs, &features)).expect("a file can be written");
        let terrain = Terrain::read(&path, &pixels(100.0)).expect("a map in degrees");
        assert_eq!(terrain.map.crs, Crs::Epsg(32616), "{crs:?}");
        let says = "are reprojected to EPSG:32616, WGS 84 / UTM zone 16N; --crs-out EPSG:N names another";
        assert!(terrain.notes.iter().any(|note| note.contains(says)), "{:?}", terrain.notes);
        for (k, (_, r)) in rings.iter().enumerate() {
            let content = &terrain.stack.slices[k].content;
            let area = (0..content.len()).filter(|n| content.inside(*n)).count() as f64 * 1e4;
            let share = area / (std::f64::consts::PI * r * r);
            assert!((share - 1.0).abs() < 0.02, "{share}");
        }
        let wanted = ReadOptions { crs_out: Some("EPSG:5070".into()), ..pixels(100.0) };
        assert_eq!(Terrain::read(&path, &wanted).expect("another system").map.crs, Crs::Epsg(5070));
    }
    let out = place.path().join("x.dem.tif").display().to_string();
    let result = interslice(&["reconstruct", &path.display().to_string(), "-o", &out, "--pixel", "200"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert_says(&stderr(&result), &["longitude and latitude (EPSG:4269) are reprojected to EPSG:32616"]);
    for (options, says) in [
        (
            &["--crs-out", "EPSG:4326"][..],
            "`crs_out` must be a system of lengths, as heights are; EPSG:4326 has degrees",
        ),
        (&["--crs-out", "metres"], "`crs_out` must be EPSG:N with 1024 <= N < 32767; got `metres`"),
        (&["--crs-out", "EPSG:1999"], "EPSG:1999 is not known to this program"),
        (
            &["--crs", "local", "--crs-out", "EPSG:32616"],
            "`crs_out` needs the system of the file: --crs EPSG:N names it",
        ),
    ] {
        assert_says(&refused_file(&path, options), &["in.geojson", says]);
    }
    let wide = [feature(100, &vec![[0.0, 0.0], [20.0, 0.0], [20.0, 5.0]]), feature(200, &vec![[0.0, 1.0], [9.0, 5.0]])];
    fs::write(&path, collection(None, &wide)).expect("a file can be written");
    assert_says(
        &refused_file(&path, &[]),
        &["the map is 20.0 degrees wide, more than the 12 that a UTM zone can hold"],
    );
    let polar = [feature(100, &vec![[0.0, 83.0], [2.0, 86.0]]), feature(200, &vec![[1.0, 83.0], [2.0, 84.0]])];
    fs::write(&path, collection(None, &polar)).expect("a file can be written");
    assert_says(&refused_file(&path, &[]), &["from latitude 83 to 86, where there is no UTM; --crs-out EPSG:N"]);
    let stack = folder();
    sound_stack(stack.path());
    for (option, value) in [("--crs-out", "EPSG:32616"), ("--z-unit", "ft")] {
        let says =
            format!("`{}` is not for anything but contour maps", option.trim_start_matches('-').replace('-', "_"));
        assert_says(&refused_file(stack.path(), &[option, value]), &[&says]);
    }
}

/// Maps across 180 degrees, and such as count from 0 to 360; a plan in metres from a corner may be as far east, but is wider.
#[test]
fn degrees_go_on_beyond_180() {
    let place = folder();
    let path = place.path().join("map.geojson");
    let rings = |[x, y]: [f64; 2], wide: f64| {
        let line =
            |r: f64| -> Line { circle([0.0; 2], r).iter().map(|p| [x + p[0] - EAST, y + p[1] - NORTH]).collect() };
        fs::write(&path, collection(None, &[feature(100, &line(wide / 2.0)), feature(150, &line(wide / 3.0))]))
            .expect("a file can be written");
    };
    for (middle, wide, wanted) in [
        ([180.0, -17.0], 0.02, Crs::Epsg(32701)),
        ([-180.0, -17.0], 0.02, Crs::Epsg(32701)),
        ([350.01, 65.0], 0.02, Crs::Epsg(32629)),
        ([179.0, 17.0], 4.0, Crs::Epsg(32660)),
        ([181.0, 40.0], 80.0, Crs::Unknown),
        ([200.0, 40.0], 13.0, Crs::Unknown),
        ([365.0, 40.0], 8.0, Crs::Unknown),
    ] {
        rings(middle, wide);
        let terrain = Terrain::read(&path, &ReadOptions::default()).expect("a map");
        assert_eq!(terrain.map.crs, wanted, "{middle:?} {wide}");
        let [dx, _] = terrain.stack.spacing;
        let across = dx * terrain.stack.dims[0] as f64;
        let widest = if wanted == Crs::Unknown { wide } else { wide * 111e3 };
        assert!(across < 4.0 * widest, "{middle:?}: {across} of {widest}");
    }
}

/// Web Mercator stretches lengths by 1 / cos(latitude), which is told where it is more than 1 %, with a system that does not.
#[test]
fn lengths_of_web_mercator_are_told() {
    let place = folder();
    let path = place.path().join("in.geojson");
    let says = "lengths in EPSG:3857, Web Mercator, are ";
    let note_of = |latitude: f64, crs_out: Option<&str>| {
        let y = 6_378_137.0 * (latitude.to_radians() / 2.0 + std::f64::consts::FRAC_PI_4).tan().ln();
        let rings = [(100, 4000.0), (150, 3000.0), (200, 2000.0)];
        let features: Vec<Value> =
            rings.iter().map(|(z, r)| feature(*z, &circle([-9_373_101.0 - EAST, y - NORTH], *r))).collect();
        fs::write(&path, collection(Some("EPSG:3857"), &features)).expect("a file can be written");
        let options = ReadOptions { crs_out: crs_out.map(Into::into), ..pixels(100.0) };
        let terrain = Terrain::read(&path, &options).expect("a map in Web Mercator");
        let notes: Vec<String> = terrain.notes.into_iter().filter(|note| note.starts_with(says)).collect();
        assert!(notes.len() < 2);
        notes.into_iter().next()
    };
    for (latitude, factor, zone) in [(36.3f64, "1.241", 32616), (-60.0, "2.000", 32716)] {
        let note = note_of(latitude, None).expect("a note");
        assert_says(&note, &[&format!("{factor} times"), &format!("{latitude:.1}"), &format!("--crs-out EPSG:{zone}")]);
        // There they are right.
        assert_eq!(note_of(latitude, Some(&format!("EPSG:{zone}"))), None);
    }
    assert_eq!(note_of(5.0, None), None);
}

#[test]
fn a_system_that_contradicts_the_files_own_is_told() {
    let place = folder();
    let path = place.path().join("map.geojson");
    let rings = [feature(100, &circle([0.0; 2], 400.0)), feature(150, &circle([0.0; 2], 200.0))];
    fs::write(&path, collection(Some("EPSG:32611"), &rings)).expect("a file can be written");
    let says = |given: &str| {
        let options = ReadOptions { crs: Some(given.into()), ..pixels(20.0) };
        let notes = Terrain::read(&path, &options).expect("a map").notes;
        notes.into_iter().find(|note| note.contains("the file names"))
    };
    assert_eq!(says("EPSG:32611"), None);
    let note = "`crs` is EPSG:32612, but the file names EPSG:32611: coordinates are taken as `crs` says";
    assert_eq!(says("EPSG:32612").as_deref(), Some(note));
    assert!(says("local").is_some_and(|note| note.starts_with("`crs` is local, but the file names EPSG:32611")));
    let shape = place.path().join("cone.shp");
    shapefile(&shape, None);
    let text = r#"PROJCS["WGS_1984_UTM_Zone_11N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]],UNIT["Meter",1.0]]"#;
    fs::write(shape.with_extension("prj"), text).expect("a file can be written");
    let said = interslice(&["inspect", &shape.display().to_string(), "--crs", "EPSG:2056"]);
    let said = String::from_utf8_lossy(&said.stdout).into_owned() + &stderr(&said);
    assert_says(&said, &["`crs` is EPSG:2056, but the file names EPSG:32611"]);
}

/// What a file says of its system may be wrong, or no such thing: who says it wins.
#[test]
fn a_system_that_is_not_understood_is_that_of_the_options() {
    let place = folder();
    let path = place.path().join("map.geojson");
    let rings = [feature(100, &circle([0.0; 2], 400.0)), feature(150, &circle([0.0; 2], 200.0))];
    let with = |crs: Value| {
        let text = serde_json::json!({"type": "FeatureCollection", "crs": crs, "features": rings}).to_string();
        fs::write(&path, text).expect("a file can be written");
    };
    let read = |crs: Option<&str>| {
        let options = ReadOptions { crs: crs.map(Into::into), ..pixels(20.0) };
        Terrain::read(&path, &options).map(|terrain| (terrain.map.crs, terrain.notes.join("; ")))
    };
    let named = |name: &str| serde_json::json!({"type": "name", "properties": {"name": name}});
    for (crs, why) in [
        (named("EPSG:999999"), "`crs` is `EPSG:999999`, whose code is none of the EPSG registry's (1024 to 32766)"),
        (named("foo bar"), "`crs` is `foo bar`; only EPSG codes are known"),
        (Value::from("foo bar"), "`crs` is `foo bar`; only EPSG codes are known"),
        (serde_json::json!({"type": "link", "properties": {"href": "x"}}), "`crs` has no properties.name"),
    ] {
        with(crs);
        assert_says(&refused_file(&path, &[]), &["map.geojson", &format!("{why}; --crs EPSG:N names the system")]);
        let said = interslice(&["inspect", &path.display().to_string(), "--crs", "EPSG:32611"]);
        assert_eq!(said.status.code(), Some(0), "{}", stderr(&said));
        let (crs, notes) = read(Some("EPSG:32611")).expect("the options say it");
        assert_eq!(crs, Crs::Epsg(32611));
        assert_says(&notes, &[&format!("{why}: coordinates are taken as --crs says")]);
    }
    with(Value::Null);
    assert_eq!(read(None).expect("a map").0, Crs::Unknown);
    with(Value::from("EPSG:32611"));
    assert_eq!(read(None).expect("a map").0, Crs::Epsg(32611));
    // A .prj that is none is told as one that is missing.
    let shape = place.path().join("cone.shp");
    shapefile(&shape, None);
    fs::write(shape.with_extension("prj"), "garbage").expect("a file can be written");
    let terrain = Terrain::read(&shape, &ReadOptions::default()).expect("a map");
    assert_eq!(terrain.map.crs, Crs::Unknown);
    assert_says(&terrain.notes.join("; "), &["no coordinate system is named; --crs EPSG:N sets it"]);
}
