//! What a run of many labels says.

use std::fs;
use std::path::Path;

use crate::files::*;

fn text(path: &Path) -> &str {
    path.to_str().expect("a name in UTF-8")
}

/// Labels that keep apart have nothing to decide, whatever their distances do.
#[test]
fn what_was_decided_between_labels_is_told_without_contradiction() {
    let place = folder();
    let (path, out) = (place.path().join("in.nrrd"), place.path().join("out.nrrd"));
    let wide = 44;
    for (apart, told) in
        [(24, "2 labels: no overlaps and no gaps between them to decide\n"), (11, "2 labels, 2 changed by others: ")]
    {
        let label = |n: usize| -> u8 {
            let [i, j, k] = [n % wide, n / wide % 24, n / (24 * wide)].map(|n| n as f64);
            let disc = |x: f64| (i - x).hypot(j - 12.0) < 5.0 + 0.1 * k;
            match k as usize % 4 {
                0 if disc(10.0) => 1,
                0 if disc(10.0 + f64::from(apart) - 0.3 * k) => 2,
                _ => 0,
            }
        };
        let voxels: Vec<u8> = (0..wide * 24 * 9).map(label).collect();
        let bytes = crate::files::nrrd("spacings: 1 1 1\nencoding: raw", "uint8", [wide, 24, 9], &voxels);
        fs::write(&path, bytes).expect("a file can be written");
        let done = interslice(&["reconstruct", text(&path), "--labels", "all", "--backend", "cpu", "-o", text(&out)]);
        let said = stderr(&done);
        assert!(done.status.success() && said.contains(told), "{apart} px apart: {said}");
    }
}
