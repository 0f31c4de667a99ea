//! The pixels of a stack that count.

use crate::surface::map::Map;

/// A box of pixels: of a map those within its border, beyond which its stack goes on.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// First column and row.
    pub first: [usize; 2],
    /// Columns and rows.
    pub dims: [usize; 2],
    /// Those of the stack.
    pub of: [usize; 2],
}

impl View {
    /// All pixels.
    pub fn whole(dims: [usize; 2]) -> Self {
        View { first: [0; 2], dims, of: dims }
    }

    /// Those of a map, else all.
    pub fn of_map(map: Option<&Map>, dims: [usize; 2]) -> Self {
        map.map_or(View::whole(dims), |map| View { first: map.first, dims: map.dims, of: dims })
    }

    /// What a value for every pixel of the stack has in view, row-major.
    pub fn of<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let rows = values.chunks(self.of[0]).skip(self.first[1]).take(self.dims[1]);
        rows.flat_map(|row| row[self.first[0]..][..self.dims[0]].iter().copied()).collect()
    }
}
