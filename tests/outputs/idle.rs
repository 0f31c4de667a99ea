//! Options for outputs that cannot be, or that change nothing.

use std::fs;
use std::path::Path;

use crate::files::{folder, interslice, sound_stack, stderr};

#[test]
fn a_wrong_simplification_is_refused_before_any_work() {
    let place = folder();
    sound_stack(place.path());
    let [input, output] = [place.path(), &place.path().join("x.stl")].map(|p| p.display().to_string());
    for wrong in ["0", "-1", "nan", "inf"] {
        let result = interslice(&["reconstruct", &input, "-o", &output, &format!("--simplify={wrong}")]);
        assert_eq!(result.status.code(), Some(2), "{wrong}");
        assert!(stderr(&result).contains("simplify"), "{}", stderr(&result));
    }
    assert!(!Path::new(&output).exists());
}

#[test]
fn an_option_for_what_is_not_written_is_told() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    let at = |name: &str| place.path().join(name).display().to_string();
    let told = |options: &[&str], name: &str| {
        let out = at(name);
        let result = interslice(&[&["reconstruct", &input, "-o", &out, "--backend", "cpu"], options].concat());
        assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
        stderr(&result)
    };
    let field: &[&str] = &["--method", "field"];
    let cases: [(&[&str], &[&str], &str, &str); 8] = [
        (&["--simplify", "0.1"], &[], "a.nrrd", "b.stl"),
        (&["--units", "m"], &[], "a.stl", "b.glb"),
        (&["--y-up"], &[], "a.stl", "c.glb"),
        (&["--contours"], &[], "a.stl", "b.png"),
        (&["--mask"], &[], "a.stl", "b.nrrd"),
        (&["--distance"], &[], "a.origin.nrrd", "c.nrrd"),
        (&["--link-reach", "5"], &["--link", "auto"], "b.stl", "b.stl"),
        (&["--cap-gaps", "1"], &["--end-top", "extrapolate"], "b.stl", "b.stl"),
    ];
    for (options, more, without, with) in cases {
        let setting = format!("`{}` changes nothing", options[0].trim_start_matches('-').replace('-', "_"));
        let [idle, used] = [told(options, without), told(&[options, more].concat(), with)];
        assert!(idle.contains(&setting), "{options:?}:\n{idle}");
        assert!(!used.contains("changes nothing"), "{options:?}:\n{used}");
    }
    // Settings that another one leaves nothing to do.
    let of_the_morph: [&[&str]; 8] = [
        &["--slope", "pchip"],
        &["--spline-end", "not-a-knot"],
        &["--sweep", "forward"],
        &["--redistance", "9"],
        &["--cfl", "0.3"],
        &["--cut-off", "2"],
        &["--seed-spacing", "1"],
        &["--tolerance", "0.2"],
    ];
    let others: [(&[&str], &[&str]); 4] = [
        (&["--sigma", "0.8"], &["--anti-alias", "none"]),
        (&["--sigma", "0.8"], &["--anti-alias", "eq6"]),
        (&["--spline-end", "not-a-knot"], &["--slope", "pchip"]),
        (&["--slope", "natural", "--fair", "0"], field),
    ];
    for (options, by) in of_the_morph.into_iter().map(|options| (options, field)).chain(others) {
        let setting = format!("`{}` changes nothing", options[0].trim_start_matches('-').replace('-', "_"));
        let bytes = |name: &str| fs::read(at(name)).expect("it was written");
        let (idle, without, used) = (
            told(&[options, by].concat(), "e.stl"),
            told(&[by, &options[2..]].concat(), "f.stl"),
            told(options, "g.stl"),
        );
        assert!(idle.contains(&setting), "{options:?} {by:?}:\n{idle}");
        assert!(bytes("e.stl") == bytes("f.stl"), "{options:?} {by:?} changes something");
        assert!(!(without + &used).contains("changes nothing"), "{options:?}:\n{used}");
    }
    // Fairing keeps to what slopes may do in both methods.
    assert!(!told(&["--slope", "natural", "--method", "field"], "h.stl").contains("changes nothing"));
    for preset in ["paper", "fast"] {
        assert!(!told(&["--preset", preset], "h.stl").contains("changes nothing"), "{preset}");
    }
    assert!(!told(&["--link-reach", "4"], "b.stl").contains("changes nothing"), "its default");
    let far = told(&["--dz", "50"], "d.nrrd");
    assert!(far.contains("`dz` is 50 mm, and the body is 8 mm high"), "{far}");
}
