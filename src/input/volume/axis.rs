//! Along which axis of a volume its slices lie.

use crate::input::volume::grid::VolumeGrid;
use crate::input::volume::survey::Survey;
use crate::stack::axis::{Axis, NAMES};

/// Spacings this near to each other, relatively, are the same: pixels of 2.3898 x 2.3852 mm are meant to be square, no scanner's slices are
/// thicker than its pixels by so little.
const SAME: f64 = 1e-2;

/// An axis, and why it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// For people.
    pub why: String,
    /// Words where another axis may be meant.
    pub doubt: Option<String>,
}

/// The axis of a volume's slices.
pub fn choose(axis: Axis, grid: &VolumeGrid, survey: &Survey) -> Choice {
    let sure = |axis: usize, why: &str| Choice { axis, why: why.into(), doubt: None };
    let stretches: [usize; 3] = std::array::from_fn(|a| lone_stretches(&survey.painted[a]));
    let asked = |axis: usize| {
        let other = (0..3).find(|&a| stretches[axis] == 0 && stretches[a] > 0);
        let doubt = other.map(|other| {
            format!(
                "slices are taken along {}, as asked, and painted ones stand alone along {}, in {} stretches with empty ones between: nothing is \
                 interpolated between those",
                NAMES[axis], NAMES[other], stretches[other]
            )
        });
        Choice { axis, why: "as asked".into(), doubt }
    };
    match axis {
        Axis::X => asked(0),
        Axis::Y => asked(1),
        Axis::Z => asked(2),
        Axis::Auto => {
            let most = stretches.iter().copied().max().unwrap_or(0);
            let sparse = stretches.map(|n| n > 0 && n == most);
            let coarse = coarsest(grid.spacing());
            let alone = sparse.iter().filter(|s| **s).count() == 1;
            match (sparse.iter().position(|s| *s), coarse) {
                (Some(axis), _) if alone => {
                    let why = format!(
                        "painted slices stand alone along it: {most} stretches of them with empty slices between"
                    );
                    let doubt = coarse.filter(|other| *other != axis).map(|other| {
                        let [own, other] = [axis, other].map(|a| NAMES[a]);
                        format!(
                            "slices are taken to lie along {own}, along which {most} stretches of painted ones have empty ones between; those of the \
                             coarsest spacing lie along {other}, which `axis` = {other} takes"
                        )
                    });
                    Choice { axis, why, doubt }
                }
                (_, Some(axis)) => sure(axis, "the coarsest spacing"),
                _ => sure(2, "no axis has lone painted slices or the coarsest spacing"),
            }
        }
    }
}

/// Stretches of painted slices where they are two or more and hold two slices at most in the mean; a body that is painted throughout and
/// happens to have two parts has longer ones.
fn lone_stretches(painted: &[bool]) -> usize {
    let count = painted.iter().filter(|p| **p).count();
    let stretches = painted.chunk_by(|a, b| a == b).filter(|stretch| stretch[0]).count();
    if stretches >= 2 && count <= 2 * stretches { stretches } else { 0 }
}

/// The axis of the largest spacing, if it is one.
fn coarsest(spacing: [f64; 3]) -> Option<usize> {
    let most = spacing.iter().copied().fold(0.0, f64::max);
    let near: Vec<usize> = (0..3).filter(|&a| spacing[a] >= most * (1.0 - SAME)).collect();
    if let &[axis] = &near[..] { Some(axis) } else { None }
}
