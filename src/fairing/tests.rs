use super::*;
use crate::grid::spline::smoothstep;

const DIMS: [usize; 2] = [41, 41];

/// Layers at the nodes and `dz` apart of a disc, as large as `radius` says of their heights, after fairing.
fn faired(contours: &[f64], dz: f64, radius: impl Fn(f64) -> f64) -> Vec<(f64, Vec<f32>)> {
    faired_between([false; 2], contours, dz, radius)
}

/// The same between ends whose slopes are steered or not.
fn faired_between(steered: [bool; 2], contours: &[f64], dz: f64, radius: impl Fn(f64) -> f64) -> Vec<(f64, Vec<f32>)> {
    faired_as([1, 0], steered, contours, dz, radius)
}

/// The same with so many nodes at once, as rugged relief or not.
fn faired_as(
    [nodes_at_once, rugged]: [usize; 2],
    steered: [bool; 2],
    contours: &[f64],
    dz: f64,
    radius: impl Fn(f64) -> f64,
) -> Vec<(f64, Vec<f32>)> {
    let gaps: Vec<f64> = contours.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let drawn = vec![true; contours.len()];
    let gap = crate::stack::heights::middle_gap(contours);
    let nodes = Nodes::new(contours.to_vec(), &drawn, gap);
    let mut fairing = Fairing::new(FairingSpec {
        moving: None,
        contours: contours.to_vec(),
        drawn,
        layers: 0..gaps.len(),
        dims: DIMS,
        spacing: [1.0; 2],
        gap,
        alpha: 1.5,
        rugged: rugged as f64,
        limited: false,
        steered,
        farthest: 100.0,
        shares: vec![None; gaps.len()],
        nodes_at_once,
    });
    let mut out = Vec::new();
    let mut sink = |layer: Layer| {
        out.push((layer.z, layer.dense()));
        Ok(())
    };
    let mut heights: Vec<f64> = (0..=nodes.last()).map(|k| nodes.height(k)).collect();
    heights.extend((0..=(gaps.iter().sum::<f64>() / dz) as usize).map(|k| contours[0] + k as f64 * dz));
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    for z in heights {
        let phi = SparseImage::of(DIMS, &given(radius(z)));
        let contour = contours.iter().position(|c| *c == z);
        fairing.push(Layer { z, phi, output: true, contour }, &mut sink).expect("pushed");
    }
    fairing.finish(&mut sink).expect("finished");
    out
}

fn largest<'a>(pairs: impl Iterator<Item = (&'a Vec<f32>, &'a Vec<f32>)>) -> f32 {
    pairs.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).abs())).fold(0.0, f32::max)
}

/// Distances to a disc.
fn given(radius: f64) -> Vec<f32> {
    let phi = |n: usize| ((n % DIMS[0]) as f64 - 20.0).hypot((n / DIMS[0]) as f64 - 20.0) - radius;
    (0..DIMS[0] * DIMS[1]).map(|n| phi(n) as f32).collect()
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
fn a_layer_does_not_depend_on_how_many_come_together() {
    let contours = stacked(&[6, 12, 3, 3, 6, 5, 5, 7]);
    let radius = |z: f64| 10.0 + 4.0 * (0.9 * z).sin();
    let one_by_one = faired(&contours, 0.5, radius);
    assert!(one_by_one.iter().any(|(z, phi)| largest([(phi, &given(radius(*z)))].into_iter()) > 0.01), "it does move");
    for nodes in [2, NODES, NODES + 1, GAPS_AT_ONCE * NODES, 1000] {
        assert!(faired_as([nodes, 0], [false; 2], &contours, 0.5, radius) == one_by_one, "{nodes} at once");
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

#[test]
fn contours_stay_and_the_crease_at_one_of_them_is_smoothed() {
    let contours = stacked(&[8, 8, 8, 8]);
    let radius = |z: f64| 14.0 - 0.5 * (z - 16.0).max(0.0);
    let layers = faired(&contours, 1.0, radius);
    let at = |z: f64| &layers.iter().find(|layer| layer.0 == z).expect("a layer there").1;
    for z in &contours {
        assert_eq!(at(*z), &given(radius(*z)), "the contour at {z} stays");
    }
    let edge = |z: f64| {
        let phi = at(z);
        let row = &phi[20 * DIMS[0] + 20..21 * DIMS[0]];
        let outside = row.iter().position(|v| *v > 0.0).expect("an end");
        outside as f32 - row[outside] / (row[outside] - row[outside - 1])
    };
    let crease = (edge(15.0) - 2.0 * edge(16.0) + edge(17.0)).abs();
    assert!(crease < 0.3, "{crease} of 0.5");
    for (z, phi) in faired(&contours, 1.0, |_| 14.0) {
        assert!(largest(std::iter::once((&phi, &given(14.0)))) < 1e-5, "height {z} of what is straight");
    }
}

/// How far fairing moves discs of these radii at most, once as of a body and once as rugged relief.
fn moves(contours: &[f64], radius: impl Fn(f64) -> f64) -> [f64; 2] {
    [0, 1].map(|rugged| {
        let mut worst = 0.0f64;
        for (z, phi) in
            faired_as([1, rugged], [false; 2], contours, 1.0, &radius).iter().filter(|(z, _)| radius(*z) > 1.0)
        {
            let row = &phi[20 * DIMS[0] + 20..21 * DIMS[0]];
            let outside = row.iter().position(|v| *v > 0.0).expect("an end");
            let edge = outside as f32 - row[outside] / (row[outside] - row[outside - 1]);
            worst = worst.max((f64::from(edge) - radius(*z)).abs());
        }
        worst
    })
}

#[test]
fn what_falls_evenly_stays_but_for_rugged_relief() {
    for fall in [4.0, 6.0] {
        let [body, rugged] = moves(&stacked(&[8, 8, 8]), |z| 19.0 - fall * z / 8.0);
        assert!(body < 0.02 && rugged > 0.06, "{fall} px a gap: {body} px, of rugged relief {rugged}");
    }
}

#[test]
fn a_neck_hardly_widens() {
    for [narrow, steep] in [[4.0, 0.8], [3.0, 1.0], [6.0, 0.9]] {
        let [body, rugged] = moves(&stacked(&[8, 8, 8, 8]), |z| (narrow + steep * (z - 16.0).powi(2)).sqrt());
        assert!(body < 0.75 * rugged && body < 0.65, "{narrow} {steep}: {body} px, of rugged relief {rugged}");
    }
}

#[test]
fn a_part_on_one_contour_alone_stays_and_the_tip_of_a_body_is_smoothed() {
    // From the contour at 8 on a cone that ends before the next one; below it nothing, or a body that it is the tip of.
    for (below, stays) in [(-200.0, true), (8.0, false)] {
        let radius = |z: f64| match z {
            _ if z < 8.0 => below,
            _ if z < 14.0 => 8.0 - (z - 8.0),
            _ => -200.0,
        };
        let layers = faired(&stacked(&[8, 8, 8]), 1.0, radius);
        let within = layers.iter().filter(|(z, _)| (8.0..14.0).contains(z));
        let moved = within.map(|(z, phi)| largest(std::iter::once((phi, &given(radius(*z)))))).fold(0.0, f32::max);
        assert_eq!(moved == 0.0, stays, "moved by {moved}");
    }
}

#[test]
fn towards_an_end_that_is_steered_smoothing_fades_out() {
    let contours = stacked(&[8, 8, 8]);
    let radius = |z: f64| 10.0 + 3.0 * (0.5 * z).sin();
    let of = |steered: [bool; 2]| faired_between(steered, &contours, 1e6, radius);
    let free = of([false; 2]);
    for steered in [[true, false], [false, true]] {
        for ((z, own), (_, other)) in of(steered).iter().zip(&free) {
            let t = match steered {
                [true, _] => z / 8.0,
                _ => (24.0 - z) / 8.0,
            };
            let given = given(radius(*z));
            let faded = |(own, free): (&f32, (&f32, &f32))| {
                let (free, given) = free;
                (own - given - smoothstep(t) as f32 * (free - given)).abs()
            };
            let off = own.iter().zip(other.iter().zip(&given)).map(faded).fold(0.0, f32::max);
            assert!(off < 1e-5, "{steered:?}, height {z}: {off}");
        }
    }
    assert!(largest(free.iter().zip(&of([true, true])).map(|(a, b)| (&a.1, &b.1))) > 0.01);
}
