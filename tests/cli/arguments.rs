//! Values of options.

use crate::files::*;

/// Messages for values that begin with a minus sign.
#[test]
fn negative_numbers_are_values() {
    let place = folder();
    sound_stack(place.path());
    let (input, out) = (place.path().display().to_string(), place.path().join("a.stl").display().to_string());
    for (options, said) in [
        (&["--dz", "-1"][..], "`dz` must be a positive number; got -1"),
        (&["--dz", "-1e-3"], "`dz` must be a positive number; got -0.001"),
        (&["--simplify", "-0.2"], "`simplify` must be a positive number; got -0.2"),
        (&["--fair", "-0.5"], "`fair` must lie in"),
        (&["--pixel", "-2"], "`pixel` must be a positive number; got -2"),
        (&["--border", "-1,2,-3,4"], "`border` is not for anything but contour maps"),
        (&["--spacing", "-1,2,3"], "`spacing` must be three positive numbers; got -1"),
        (&["--labels", "-1,-2"], "`labels` is not for a folder of slices"),
        (&["--label", "-3"], "`label` must be a value of the pixels (0, 255); got -3"),
        (&["--axis", "-z"], "invalid value '-z' for '--axis <AXIS>'\n  [possible values: auto, x, y, z]"),
        (&["--backend", "-cpu"], "invalid value '-cpu' for '--backend"),
        (&["--slices", "-1,2"], "invalid value '-1' for '--slices <I,J,..>': expected a whole number, 0 or more"),
        (&["--keep", "-2"], "invalid value '-2' for '--keep <K>': expected a whole number, 0 or more"),
        (&["--threads", "-2"], "invalid value '-2' for '--threads <N>': expected a whole number, 0 or more"),
        (
            &["--border", "-1,two"],
            "invalid value '-1,two' for '--border <box|hull|X0,Y0,X1,Y1>': expected box, hull or four",
        ),
        (&["--label", "liver"], "`label` is the value of the pixels in a folder of images, a number"),
        (&["--dz", "--mask"], "--dz lacks its value: --mask, which follows it, is an option"),
        (&["--label", "--mask"], "--label lacks its value: --mask, which follows it, is an option"),
        (&["--axis", "-q"], "--axis lacks its value: -q, which follows it, is an option"),
        (&["--dz", "--masks"], "invalid value '--masks' for '--dz <HEIGHT>': expected a number"),
    ] {
        let result = interslice(&[&["reconstruct", &input, "-o", &out], options].concat());
        assert_eq!(result.status.code(), Some(2), "{options:?}: {}", stderr(&result));
        assert!(stderr(&result).contains(said), "{options:?}: `{said}` is missing from: {}", stderr(&result));
    }
    let slopes = ["--end-top", "extrapolate", "--clamp-top", "-0.5"];
    let result = interslice(&[&["reconstruct", &input, "-o", &out, "-q"], &slopes[..]].concat());
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
}
