//! Connected components of a mask.

use std::ops::Range;

/// Labelled parts of a mask.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Components {
    /// Part of each pixel, numbered from 1 in row order of the first pixel; 0 where the mask is off.
    pub labels: Vec<u32>,
    /// Number of parts.
    pub count: usize,
}

/// Parts joined through edges (the rule for solids).
pub fn label4(mask: &[bool], dims: [usize; 2]) -> Components {
    label(mask, dims, false)
}

/// Parts joined through edges and corners (the rule for the background).
pub fn label8(mask: &[bool], dims: [usize; 2]) -> Components {
    label(mask, dims, true)
}

/// Run by run: from a run of pixels to those that touch it in the rows beside.
fn label(mask: &[bool], [nx, ny]: [usize; 2], corners: bool) -> Components {
    let mut labels = vec![0u32; mask.len()];
    let mut count = 0u32;
    let mut open: Vec<Range<usize>> = Vec::new();
    // Labels the run through `node` and gives its ends.
    let take = |node: usize, label: u32, labels: &mut [u32]| {
        let row = node / nx * nx;
        let first = (row..node).rev().take_while(|&n| mask[n]).last().unwrap_or(node);
        let end = (node..row + nx).find(|&n| !mask[n]).unwrap_or(row + nx);
        labels[first..end].fill(label);
        first..end
    };
    for start in 0..mask.len() {
        if !mask[start] || labels[start] != 0 {
            continue;
        }
        count += 1;
        open.push(take(start, count, &mut labels));
        while let Some(run) = open.pop() {
            let (row, wider) = (run.start / nx, usize::from(corners));
            let (left, right) = (run.start % nx, (run.end - 1) % nx);
            for beside in [row.checked_sub(1), Some(row + 1).filter(|r| *r < ny)].into_iter().flatten() {
                let (mut node, end) =
                    (beside * nx + left.saturating_sub(wider), beside * nx + (right + wider).min(nx - 1));
                while node <= end {
                    if mask[node] && labels[node] == 0 {
                        let found = take(node, count, &mut labels);
                        node = found.end;
                        open.push(found);
                    } else {
                        node += 1;
                    }
                }
            }
        }
    }
    Components { labels, count: count as usize }
}
