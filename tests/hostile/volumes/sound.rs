//! Sound volumes are taken, whoever wrote them and whatever they are called.

use std::fs;

use interslice::input::read;
use interslice::stack::ReadOptions;

use super::sources::*;
use crate::files::*;

#[test]
fn sound_volumes_are_taken() {
    let place = folder();
    for name in NAMES {
        let path = place.path().join(name);
        fs::write(&path, sound(name)).expect("a file can be written");
        let stack = read(&path, &ReadOptions::default()).expect(name);
        assert_eq!(stack.dims, [12, 10], "{name}");
        assert_eq!(stack.slices.len(), 5, "{name}");
        let inside = |k: usize| (0..120).filter(|&n| stack.slices[k].content.inside(n)).count();
        assert_eq!((0..5).map(inside).collect::<Vec<_>>(), [inside(0); 5], "{name}");
        assert!(stack.slices[2].content.inside(4 * 12 + 5) && !stack.slices[2].content.inside(0), "{name}");
    }
}

/// Files whose names say nothing, or something else.
#[test]
fn formats_are_known_by_content() {
    let place = folder();
    for (name, other) in [
        ("a.nrrd", "a"),
        ("a.nii", "b"),
        ("a.nii.gz", "c.nii"),
        ("a.nii.gz", "c"),
        ("a.mha", "d.nrrd"),
        ("a.nii.gz", "e.dat"),
        ("a.npy", "f"),
        ("a.tif", "g.bin"),
    ] {
        let path = place.path().join(other);
        fs::write(&path, sound(name)).expect("a file can be written");
        let stack = read(&path, &ReadOptions::default()).expect(other);
        assert_eq!((stack.dims, stack.slices.len()), ([12, 10], 5), "{other}");
    }
    let plain = place.path().join("notes");
    fs::write(&plain, "some notes").expect("a file can be written");
    let result = interslice(&["inspect", &plain.display().to_string()]);
    assert_eq!(result.status.code(), Some(2));
    let says =
        "notes: not a known input: expected a folder with stack.json, of images, or of masks, a label volume (.nrrd";
    assert!(stderr(&result).contains(says), "{}", stderr(&result));
}

/// Files by numpy, nibabel and tifffile: 12 x 10 x 3 voxels of 0.5 x 0.5 x 2 mm, where they say so.
#[test]
fn files_of_the_fields_own_writers_are_read() {
    let place = folder();
    let wanted = {
        let path = place.path().join("a.npz");
        fs::write(&path, &seed("npz/plain")[0]).expect("a file can be written");
        read(&path, &ReadOptions { spacing: Some(vec![0.5, 0.5, 2.0]), ..Default::default() }).expect("it is sound")
    };
    assert_eq!((wanted.dims, wanted.slices.len(), wanted.spacing), ([12, 10], 3, [0.5; 2]));
    assert!(wanted.slices[1].content.inside(4 * 12 + 5) && !wanted.slices[1].content.inside(0));
    for (name, seeds, sized) in [
        ("b.npz", "npz/packed", false),
        ("b", "npz/packed", false),
        ("c.nii", "nifti/two", true),
        ("c", "nifti/two", true),
        ("d.hdr", "analyze/analyze", true),
        ("d.img", "analyze/analyze", true),
        ("e.hdr", "analyze/nifti", true),
        ("e.img", "analyze/nifti", true),
        #[cfg(feature = "zstd")]
        ("f.tif", "tiff/zstd", false),
    ] {
        let path = place.path().join(name);
        let files = seed(seeds);
        let names = if files.len() == 2 {
            vec![path.with_extension("hdr"), path.with_extension("img")]
        } else {
            vec![path.clone()]
        };
        names.iter().zip(&files).for_each(|(path, bytes)| fs::write(path, bytes).expect("a file can be written"));
        let spacing = (!sized).then(|| vec![0.5, 0.5, 2.0]);
        let stack = read(&path, &ReadOptions { spacing, ..Default::default() }).expect(name);
        assert_eq!((stack.dims, stack.slices.len(), stack.spacing), ([12, 10], 3, [0.5; 2]), "{name}");
        let same = |k: usize| (0..120).all(|n| stack.slices[k].content.inside(n) == wanted.slices[k].content.inside(n));
        assert!((0..3).all(same), "{name}");
        assert_eq!(interslice::input::files(&path).expect(name), names, "{name}");
    }
}
