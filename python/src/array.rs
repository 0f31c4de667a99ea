//! Arrays of numpy: read where they lie, in any order, stride, type and byte order.

use std::io::{self, Read};
use std::sync::Arc;

use interslice::input::volume::data::GivenVoxels;
use interslice::input::volume::element::Element;
use numpy::{PyArrayDescrMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::{unlike, wrong};

/// An array that stays where it is.
#[derive(Debug)]
pub struct Array {
    /// Keeps the memory alive.
    _owner: Py<PyUntypedArray>,
    data: *const u8,
    /// Sizes of the axes, in the array's order.
    pub shape: Vec<usize>,
    strides: Vec<isize>,
    /// Type of a value, and whether its bytes run from the largest.
    pub element: (Element, bool),
}

// SAFETY: the pointer is that of the array in `_owner`, which lives as long as this does and, being referred to, is neither moved nor resized by
// numpy (`resize` with `refcheck=False` breaks that, as it does for every user of an array). Threads only read through it, byte by byte into buffers of
// their own. A thread of Python that writes into the array meanwhile races with them, as it does with numpy's own loops: the caller leaves it alone.
unsafe impl Send for Array {}
// SAFETY: as above.
unsafe impl Sync for Array {}

impl Array {
    /// An array of numbers or truth values; `name` is the argument's.
    pub fn new(name: &str, array: &Bound<'_, PyUntypedArray>) -> PyResult<Arc<Self>> {
        let descr = array.dtype();
        let size = descr.itemsize();
        let element = match (descr.kind(), size) {
            (b'b', 1) => Element::Int { size: 1, signed: false },
            (b'u', 1 | 2 | 4 | 8) => Element::Int { size, signed: false },
            (b'i', 1 | 2 | 4 | 8) => Element::Int { size, signed: true },
            (b'f', 4) => Element::Float,
            (b'f', 8) => Element::Double,
            _ => {
                let kind = descr.str()?;
                return Err(unlike(format!(
                    "`{name}` must be an array of integers, bool, float32 or float64; got one of {kind}"
                )));
            }
        };
        let big_endian = match descr.byteorder() {
            b'>' => true,
            b'=' => cfg!(target_endian = "big"),
            _ => false,
        };
        // SAFETY: the object is an array, whose header stays as it is while it is referred to.
        let data = unsafe { (*array.as_array_ptr()).fields.data }.cast::<u8>().cast_const();
        Ok(Arc::new(Array {
            data,
            shape: array.shape().to_vec(),
            strides: array.strides().to_vec(),
            element: (element, big_endian),
            _owner: array.clone().unbind(),
        }))
    }

    /// Copies the bytes of `count` values along the axis `along` from the place `at` on.
    fn copy(&self, at: &[usize], along: usize, out: &mut [u8]) {
        let size = self.element.0.size();
        let offset = |at: &[usize]| at.iter().zip(&self.strides).map(|(i, stride)| *i as isize * stride).sum::<isize>();
        let (start, stride) = (offset(at), self.strides[along]);
        if stride == size as isize {
            // SAFETY: `at` and as many values along the axis as `out` holds lie within the array: callers stay within its shape.
            unsafe { std::ptr::copy_nonoverlapping(self.data.offset(start), out.as_mut_ptr(), out.len()) };
            return;
        }
        for (k, value) in out.chunks_exact_mut(size).enumerate() {
            // SAFETY: as above, value by value.
            unsafe {
                let from = self.data.offset(start + k as isize * stride);
                std::ptr::copy_nonoverlapping(from, value.as_mut_ptr(), size);
            }
        }
    }

    /// The values of a plane of two axes, row by row, as f64.
    pub fn plane(&self, fixed: Option<usize>, each: &mut dyn FnMut(f64)) {
        let [rows, columns] = [self.shape[self.shape.len() - 2], self.shape[self.shape.len() - 1]];
        let size = self.element.0.size();
        let mut bytes = vec![0; columns * size];
        for j in 0..rows {
            let at: Vec<usize> = fixed.into_iter().chain([j, 0]).collect();
            self.copy(&at, self.shape.len() - 1, &mut bytes);
            bytes.chunks_exact(size).for_each(|value| each(self.number(value)));
        }
    }

    /// The whole numbers of a row along the axis `along` from the place `at` on, those of floats without what follows the point.
    pub fn row(&self, at: &[usize], along: usize, row: &mut [i64]) {
        let size = self.element.0.size();
        let mut bytes = vec![0; row.len() * size];
        self.copy(at, along, &mut bytes);
        row.iter_mut().zip(bytes.chunks_exact(size)).for_each(|(number, value)| *number = self.whole_number(value));
    }

    /// The number that some bytes are; integers beyond 2^53 are rounded.
    fn number(&self, bytes: &[u8]) -> f64 {
        let little = self.little(bytes);
        match self.element.0 {
            Element::Float => f32::from_le_bytes([little[0], little[1], little[2], little[3]]).into(),
            Element::Double => f64::from_le_bytes(little),
            Element::Int { size, signed } => whole(little, size, signed) as f64,
        }
    }

    /// The same as a whole number.
    fn whole_number(&self, bytes: &[u8]) -> i64 {
        match self.element.0 {
            Element::Int { size, signed } => whole(self.little(bytes), size, signed),
            _ => self.number(bytes) as i64,
        }
    }

    /// The bytes of a value, the least first.
    fn little(&self, bytes: &[u8]) -> [u8; 8] {
        let mut little = [0; 8];
        little[..bytes.len()].copy_from_slice(bytes);
        if self.element.1 {
            little[..bytes.len()].reverse();
        }
        little
    }
}

/// An integer of `size` bytes, the least first.
fn whole(little: [u8; 8], size: usize, signed: bool) -> i64 {
    let value = i64::from_le_bytes(little);
    if !signed || size == 8 {
        return value;
    }
    let unused = 64 - 8 * size as u32;
    value << unused >> unused
}

/// A volume's voxels in an array, read along axes of the volume's choice.
#[derive(Debug)]
pub struct Voxels {
    /// The array.
    pub array: Arc<Array>,
    /// The array's axes, the fastest that is read first.
    pub order: [usize; 3],
}

impl Voxels {
    /// The order in which memory is read with the smallest strides: the fastest axis first.
    pub fn new(array: Arc<Array>) -> Self {
        let mut order = [2, 1, 0];
        order.sort_by_key(|&axis| array.strides[axis].unsigned_abs());
        Voxels { array, order }
    }
}

impl GivenVoxels for Voxels {
    fn open(&self) -> Box<dyn Read + Send> {
        Box::new(Reader { array: self.array.clone(), order: self.order, next: 0, row: Vec::new(), used: 0 })
    }
}

/// Reads an array row by row.
struct Reader {
    array: Arc<Array>,
    order: [usize; 3],
    /// The row that is read next.
    next: usize,
    row: Vec<u8>,
    used: usize,
}

impl Read for Reader {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.used == self.row.len() {
            let [fast, middle, slow] = self.order;
            let shape = &self.array.shape;
            if self.next == shape[middle] * shape[slow] || shape[fast] == 0 {
                return Ok(0);
            }
            let mut at = [0; 3];
            (at[middle], at[slow]) = (self.next % shape[middle], self.next / shape[middle]);
            self.row.resize(shape[fast] * self.array.element.0.size(), 0);
            self.array.copy(&at, fast, &mut self.row);
            (self.next, self.used) = (self.next + 1, 0);
        }
        let count = out.len().min(self.row.len() - self.used);
        out[..count].copy_from_slice(&self.row[self.used..self.used + count]);
        self.used += count;
        Ok(count)
    }
}

/// An array of so many axes, or an error that names the argument.
pub fn of_axes(name: &str, array: &Bound<'_, PyUntypedArray>, axes: usize) -> PyResult<Arc<Array>> {
    if array.ndim() != axes {
        return Err(wrong(name, format!("must have {axes} axes; got {}", array.ndim())));
    }
    if array.shape().contains(&0) {
        return Err(wrong(name, format!("must not be empty; got the shape {:?}", array.shape())));
    }
    Array::new(name, array)
}

/// An array that this module has made, and that nobody else knows yet.
pub struct NewArray {
    array: Py<PyUntypedArray>,
    data: *mut u8,
    strides: [isize; 3],
    shape: [usize; 3],
    element: (Element, bool),
}

// SAFETY: the array is new and known to nobody but the thread that fills it; `array` keeps its memory.
unsafe impl Send for NewArray {}

impl NewArray {
    /// An array like `like`, whose values are not set.
    pub fn like(like: &Bound<'_, PyUntypedArray>, read: &Array) -> PyResult<Self> {
        let py = like.py();
        let numpy = py.import("numpy")?;
        let options = pyo3::types::PyDict::new(py);
        // A plain array even of a subclass.
        options.set_item("subok", false)?;
        let array = numpy.call_method("empty_like", (like,), Some(&options))?.cast_into::<PyUntypedArray>()?;
        let (shape, strides) = (array.shape().to_vec(), array.strides().to_vec());
        // SAFETY: the object is an array.
        let data = unsafe { (*array.as_array_ptr()).fields.data }.cast::<u8>();
        Ok(NewArray {
            data,
            strides: [strides[0], strides[1], strides[2]],
            shape: [shape[0], shape[1], shape[2]],
            element: read.element,
            array: array.unbind(),
        })
    }

    /// The array, for Python.
    pub fn into_inner(self) -> Py<PyUntypedArray> {
        self.array
    }

    /// Sets the row of values along the axis `along` from the place `at` on, but for those that `from` has there and that are `kept`.
    pub fn set_row(&mut self, at: [usize; 3], along: usize, values: &[i64], from: &Array, kept: &dyn Fn(i64) -> bool) {
        let size = self.element.0.size();
        let mut old = vec![0u8; values.len() * size];
        from.copy(&at, along, &mut old);
        debug_assert!(at[along] + values.len() <= self.shape[along]);
        let start: isize = at.iter().zip(&self.strides).map(|(i, stride)| *i as isize * stride).sum();
        for (k, (value, old)) in values.iter().zip(old.chunks_exact(size)).enumerate() {
            let mut new = [0u8; 8];
            let before = from.number(old) as i64;
            if before != 0 && kept(before) {
                new[..size].copy_from_slice(old);
            } else {
                self.bytes(*value, &mut new[..size]);
            }
            // SAFETY: the row lies within the array.
            unsafe {
                let to = self.data.offset(start + k as isize * self.strides[along]);
                std::ptr::copy_nonoverlapping(new.as_ptr(), to, size);
            }
        }
    }

    fn bytes(&self, value: i64, out: &mut [u8]) {
        match self.element.0 {
            Element::Int { size, .. } => out.copy_from_slice(&value.to_le_bytes()[..size]),
            Element::Float => out.copy_from_slice(&(value as f32).to_le_bytes()),
            Element::Double => out.copy_from_slice(&(value as f64).to_le_bytes()),
        }
        if self.element.1 {
            out.reverse();
        }
    }
}
