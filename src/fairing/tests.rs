use super::*;
use crate::reference::Reference;

const DIMS: [usize; 2] = [41, 41];

/// Layers at the nodes and `dz` apart of a disc, as large as `radius` says of their heights, after fairing.
fn faired(contours: &[f64], dz: f64, radius: impl Fn(f64) -> f64) -> Vec<(f64, Vec<f32>)> {
    let gaps: Vec<f64> = contours.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let nodes = Nodes::new(contours.to_vec());
    let spec = FairingSpec {
        moving: None,
        contours: contours.to_vec(),
        layers: 0..gaps.len(),
        dims: DIMS,
        spacing: [1.0; 2],
        gap: crate::stack::heights::median(gaps.clone()),
        alpha: 1.5,
        limited: false,
        steered: [false; 2],
        farthest: 100.0,
        shares: vec![None; gaps.len()],
    };
    let mut fairing = Fairing::new(spec, &Reference).expect("a fairing");
    let mut out = Vec::new();
    let mut sink = |layer: Layer| {
        out.push((layer.z, layer.phi));
        Ok(())
    };
    let mut heights: Vec<f64> = (0..=nodes.last()).map(|k| nodes.height(k)).collect();
    heights.extend((0..=(gaps.iter().sum::<f64>() / dz) as usize).map(|k| contours[0] + k as f64 * dz));
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    for z in heights {
        let phi = |n: usize| ((n % DIMS[0]) as f64 - 20.0).hypot((n / DIMS[0]) as f64 - 20.0) - radius(z);
        let phi = (0..DIMS[0] * DIMS[1]).map(|n| phi(n) as f32).collect();
        let contour = contours.iter().position(|c| *c == z);
        fairing.push(Layer { z, phi, output: true, contour }, &mut sink).expect("pushed");
    }
    fairing.finish(&mut sink).expect("finished");
    out
}

fn largest<'a>(pairs: impl Iterator<Item = (&'a Vec<f32>, &'a Vec<f32>)>) -> f32 {
    pairs.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).abs())).fold(0.0, f32::max)
}

/// Contours with these gaps from 0 on.
fn stacked(gaps: &[u32]) -> Vec<f64> {
    let below = |i: usize| f64::from(gaps[..i].iter().sum::<u32>());
    (0..=gaps.len()).map(below).collect()
}

#[test]
fn upside_down_it_is_the_same() {
    for (gaps, dz) in [([6, 12, 3, 3, 6], 0.5), ([5, 20, 4, 3, 24], 0.5), ([10, 10, 20, 10, 10], 1.0)] {
        let contours = stacked(&gaps);
        let top = contours[contours.len() - 1];
        let turned: Vec<f64> = contours.iter().rev().map(|z| top - z).collect();
        let radius = |z: f64| 10.0 + 4.0 * (0.9 * z).sin();
        let (up, down) = (faired(&contours, dz, radius), faired(&turned, dz, |z| radius(top - z)));
        assert_eq!(up.len(), down.len());
        let apart = largest(up.iter().zip(down.iter().rev()).map(|(a, b)| (&a.1, &b.1)));
        assert!(apart < 2e-5, "{gaps:?}: {apart}");
    }
}

#[test]
fn a_layer_does_not_depend_on_which_others_come() {
    let contours = stacked(&[6, 12, 3, 3, 6]);
    let radius = |z: f64| 10.0 + 4.0 * (0.9 * z).sin();
    let fine = faired(&contours, 0.25, radius);
    for dz in [0.5, 1.0, 4.0] {
        for (z, phi) in faired(&contours, dz, radius) {
            let same = fine.iter().find(|(other, _)| *other == z).expect("a layer there");
            assert_eq!(same.1, phi, "dz {dz}, height {z}");
        }
    }
}

#[test]
fn heights_have_no_unit() {
    let contours = stacked(&[6, 12, 3, 3, 6]);
    let radius = |z: f64| 10.0 + 4.0 * (0.9 * z).sin();
    // Nodes alone, and the first layer.
    let own = faired(&contours, 1e6, radius);
    for unit in [0.1, 10.0] {
        let stretched: Vec<f64> = contours.iter().map(|z| unit * z).collect();
        let other = faired(&stretched, 1e6, |z| radius(z / unit));
        let apart = largest(own.iter().zip(&other).map(|(a, b)| (&a.1, &b.1)));
        assert!(apart < 1e-4, "unit {unit}: {apart}");
    }
}

#[test]
fn a_little_change_of_the_layers_changes_little() {
    // Rings of symmetric pixels pass every threshold together on the way.
    const STEP: f64 = 2e-3;
    let radius = |z: f64, more: f64| 8.0 + 6.0 * (z * std::f64::consts::PI / 8.0).sin() + more;
    let body = |k: u32| faired(&[0.0, 8.0, 16.0], 1.0, |z| radius(z, f64::from(k) * STEP));
    let bodies: Vec<Vec<(f64, Vec<f32>)>> = (0..400).into_par_iter().map(body).collect();
    let change = |pair: &[Vec<(f64, Vec<f32>)>]| largest(pair[0].iter().zip(&pair[1]).map(|(a, b)| (&a.1, &b.1)));
    let largest = bodies.windows(2).map(change).fold(0.0, f32::max);
    println!("largest change {largest} at a step of {STEP}");
    assert!(largest < 6.0 * STEP as f32, "{largest}");
}
