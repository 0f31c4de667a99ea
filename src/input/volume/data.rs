//! The bytes of a volume's voxels, opened anew for every pass.

use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::{DeflateDecoder, MultiGzDecoder, ZlibDecoder};

use super::Volume;
use super::element::Element;
use super::tiff_pages::Pages;
#[cfg(feature = "zarr")]
use super::zarr_slabs;
use crate::input::images::OneByOne;
use crate::input::masks::SideBySide;
use crate::input::volume::grid::Failure;
use crate::storage::regular;

/// Most bytes that one byte of deflate can stand for (1032), of bzip2 (blocks of 900 000 bytes, of which 5 stand for 259, packed into 32), of the
/// codecs of TIFF (zstd: blocks of 128 KiB in 4 bytes).
const MOST_DEFLATED: u64 = 1032;
const MOST_IN_BLOCKS: u64 = 1 << 21;
const MOST_IN_PAGES: u64 = 1 << 15;

/// Packing of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coding {
    /// None: bytes as they are.
    Raw,
    /// gzip, one member or more.
    Gzip,
    /// zlib.
    Zlib,
    /// Deflate alone, as in ZIP.
    Deflate,
    /// bzip2, one stream or more.
    Bzip2,
}

/// Place of bytes.
#[derive(Debug, Clone)]
pub enum Data {
    /// In one piece.
    Stream {
        /// The file.
        file: PathBuf,
        /// Offset at which they begin.
        offset: u64,
        /// Their packing.
        coding: Coding,
        /// Unpacked bytes before the first voxel.
        skip: u64,
    },
    /// In the pages of a TIFF.
    Pages {
        /// The file.
        file: PathBuf,
        /// Number of pages.
        count: usize,
        /// Bytes of a page.
        bytes: usize,
    },
    /// In the chunks of a Zarr array.
    #[cfg(feature = "zarr")]
    Zarr {
        /// Its folder.
        array: PathBuf,
        /// Places along its axes.
        sizes: Vec<usize>,
        /// Bytes of a voxel.
        voxel: usize,
    },
    /// In images, a slice each.
    Images {
        /// The files.
        files: Vec<PathBuf>,
        /// Columns and rows of each.
        dims: [usize; 2],
        /// Type of a voxel.
        element: Element,
    },
    /// In masks, volumes of their own.
    Masks(Vec<Volume>),
    /// In memory that belongs to somebody else.
    Given(Arc<dyn GivenVoxels>),
}

/// Voxels in memory, as many as their volume has.
pub trait GivenVoxels: std::fmt::Debug + Send + Sync {
    /// Reads their bytes from the first voxel on, in the order in which the volume stores them.
    fn open(&self) -> Box<dyn Read + Send>;
}

impl Data {
    /// The file.
    pub fn file(&self) -> &Path {
        match self {
            Data::Stream { file, .. } | Data::Pages { file, .. } => file,
            #[cfg(feature = "zarr")]
            Data::Zarr { array, .. } => array,
            Data::Images { files, .. } => files.first().map_or(Path::new(""), PathBuf::as_path),
            Data::Masks(masks) => masks.first().map_or(Path::new(""), |mask| &mask.path),
            Data::Given(_) => Path::new("memory"),
        }
    }

    fn named<T>(&self, result: io::Result<T>) -> Failure<T> {
        result.map_err(|e| format!("data in {}: {e}", self.file().display()))
    }

    /// Whether the file can hold `needed` bytes, before any of them is asked for.
    pub(crate) fn check(&self, needed: u64) -> Failure<()> {
        #[cfg(feature = "zarr")]
        if let Data::Zarr { array, voxel, .. } = self {
            return zarr_slabs::check(array, *voxel, needed);
        }
        if matches!(self, Data::Given(_)) {
            return Ok(());
        }
        let length = self.named(std::fs::metadata(self.file()))?.len();
        match *self {
            Data::Stream { coding: Coding::Raw, offset, skip, .. } => {
                match length.saturating_sub(offset).saturating_sub(skip) {
                    there if there < needed => Err(format!("data end after {there} of {needed} bytes")),
                    _ => Ok(()),
                }
            }
            Data::Stream { offset, coding, .. } => {
                let most = if coding == Coding::Bzip2 { MOST_IN_BLOCKS } else { MOST_DEFLATED };
                packed(length.saturating_sub(offset), most, needed)
            }
            // Each was checked when its header was read, and each image is when it is read.
            Data::Images { .. } | Data::Masks(_) | Data::Given(_) => Ok(()),
            #[cfg(feature = "zarr")]
            Data::Zarr { .. } => Ok(()),
            Data::Pages { .. } => packed(length, MOST_IN_PAGES, needed),
        }
    }

    /// Reads from the first voxel on.
    pub(crate) fn open(&self) -> Failure<Box<dyn Read>> {
        match self {
            Data::Images { files, dims, element } => Ok(Box::new(OneByOne::new(files.clone(), *dims, *element))),
            Data::Masks(masks) => Ok(Box::new(SideBySide::open(masks)?)),
            #[cfg(feature = "zarr")]
            Data::Zarr { array, sizes, voxel } => Ok(Box::new(zarr_slabs::Slabs::open(array, sizes, *voxel)?)),
            Data::Given(voxels) => Ok(voxels.open()),
            Data::Pages { file, count, bytes } => Ok(Box::new(Pages::open(file, *count, *bytes)?)),
            Data::Stream { file, offset, coding, skip } => {
                let mut input = BufReader::with_capacity(1 << 18, self.named(regular::open(file))?);
                self.named(input.seek(SeekFrom::Start(*offset)))?;
                let mut input: Box<dyn Read> = match coding {
                    Coding::Raw => Box::new(input),
                    Coding::Gzip => Box::new(MultiGzDecoder::new(input)),
                    Coding::Zlib => Box::new(ZlibDecoder::new(input)),
                    Coding::Deflate => Box::new(DeflateDecoder::new(input)),
                    Coding::Bzip2 => Box::new(MultiBzDecoder::new(input)),
                };
                self.named(io::copy(&mut input.by_ref().take(*skip), &mut io::sink()))?;
                Ok(input)
            }
        }
    }
}

fn packed(length: u64, most: u64, needed: u64) -> Failure<()> {
    let limit = length.saturating_mul(most);
    if needed > limit {
        return Err(format!(
            "{needed} bytes of voxels are more than {length} compressed bytes can hold (at most {limit})"
        ));
    }
    Ok(())
}

/// Reads on behind the last voxel: only where packed bytes end their checksum is compared.
pub(crate) fn end(input: &mut impl Read) -> Failure<()> {
    loop {
        match input.read(&mut [0]) {
            Ok(_) => return Ok(()),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(format!("data, behind the last voxel: {e}")),
        }
    }
}

/// Fills `bytes`, which begin at byte `at` of `all`.
pub(crate) fn fill(input: &mut impl Read, bytes: &mut [u8], at: u64, all: u64) -> Failure<()> {
    let mut done = 0;
    while done < bytes.len() {
        match input.read(&mut bytes[done..]) {
            Ok(0) => return Err(format!("data end after {} of {all} bytes", at + done as u64)),
            Ok(n) => done += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
                return Err(format!("data end after {} of {all} bytes", at + done as u64));
            }
            Err(e) => return Err(format!("data: {e}")),
        }
    }
    Ok(())
}
