//! Connected components of a mask.

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

fn label(mask: &[bool], [nx, ny]: [usize; 2], corners: bool) -> Components {
    let mut labels = vec![0u32; mask.len()];
    let mut count = 0u32;
    let mut open = Vec::new();
    for start in 0..mask.len() {
        if !mask[start] || labels[start] != 0 {
            continue;
        }
        count += 1;
        labels[start] = count;
        open.push(start);
        while let Some(node) = open.pop() {
            let (i, j) = (node % nx, node / nx);
            for row in j.saturating_sub(1)..=(j + 1).min(ny - 1) {
                for column in i.saturating_sub(1)..=(i + 1).min(nx - 1) {
                    let next = row * nx + column;
                    if mask[next] && labels[next] == 0 && (corners || row == j || column == i) {
                        labels[next] = count;
                        open.push(next);
                    }
                }
            }
        }
    }
    Components { labels, count: count as usize }
}
