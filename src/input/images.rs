//! A folder of images, one slice each, as a volume of labels: what `label` and `labels` choose from.

use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::contents::images_of;
use super::folder::beside;
use super::grey_image::Grey;
use super::palette::Indexed;
use super::slice_names::{repeats, series, skips};
use super::sniff;
use super::volume::data::Data;
use super::volume::element::Element;
use super::volume::grid::{Failure, VolumeGrid};
use super::volume::tiff_pages::{Pages, decoder, page};
use super::volume::{Lacking, Volume};
use crate::error::{Error, Result};
use crate::storage::room;

/// What many labels have instead of a stack.json.
const WITH_LABELS: &str = ", or for `labels`, which takes none, put an image with nothing painted where one is missing";

/// Reads the names of the images in a folder, and what the first is like. No file says how far apart they are.
///
/// # Errors
/// [`Error::Read`]; [`Error::Format`] for a TIFF of several pages; [`Error::Slice`] for a first image that cannot be read.
pub(super) fn read(folder: &Path) -> Result<Volume> {
    let names = images_of(folder)?;
    let Some(first) = names.first() else {
        return Err(Error::Format { path: folder.into(), message: "has no images".into() });
    };
    let of_slices: Vec<&str> = names.iter().map(String::as_str).collect();
    let told =
        series(&of_slices).or_else(|| repeats(&of_slices)).or_else(|| skips(&of_slices).map(|told| told + WITH_LABELS));
    let notes = beside(folder)?.into_iter().chain(told).collect();
    let image = Image::read(&folder.join(first));
    let image = image.map_err(|message| Error::Slice { index: 0, name: first.clone(), message })?;
    let grid = VolumeGrid { unit: "mm".into(), ..VolumeGrid::unspaced([image.dims[0], image.dims[1], names.len()]) };
    let lacks =
        format!("has {} images, and nothing says how far apart they are: say --spacing DX,DY,DZ (mm)", names.len());
    let files = names.into_iter().map(|name| folder.join(name)).collect();
    let (dims, element) = (image.dims, image.element);
    // Both decoders give the machine's own byte order.
    let of_bytes = (element, cfg!(target_endian = "big"));
    let volume = Volume::new(folder, "folder of images", grid, of_bytes, Data::Images { files, dims, element });
    volume.check()?;
    Ok(Volume { notes, lacks: Some(Lacking::Needed(lacks)), ..volume })
}

/// Whether the images of a folder have numbers that no grey slice has: signed ones, those of 32 bits and more, floats.
pub(super) fn are_of_other_numbers(folder: &Path) -> bool {
    let first = images_of(folder).ok().and_then(|names| names.into_iter().next()).map(|name| folder.join(name));
    let element = |path: PathBuf| page(&mut decoder(&path).ok()?).ok().map(|(_, element)| element);
    let of_tiff = first.filter(|path| sniff::format(path) == Some("tiff")).and_then(element);
    of_tiff.is_some_and(|element| !matches!(element, Element::Int { size: 1 | 2, signed: false }))
}

/// The labels of one image.
struct Image {
    /// Columns and rows.
    dims: [usize; 2],
    /// Type of a label.
    element: Element,
    /// Labels, row by row.
    bytes: Vec<u8>,
    /// Colours that stand for them, of a PNG that has a palette.
    palette: Vec<[u8; 3]>,
}

impl Image {
    fn read(path: &Path) -> Failure<Self> {
        // In a TIFF the number in the file is the label, of any type, however it is shown.
        if sniff::format(path) == Some("tiff") {
            let (dims, element) = page(&mut decoder(path)?)?;
            let length = dims[0].checked_mul(dims[1]).and_then(|n| n.checked_mul(element.size()));
            let length = length.ok_or_else(|| format!("{}x{} px are too many", dims[0], dims[1]))?;
            room::check_room(length as f64).map_err(|m| format!("{}x{} px {m}", dims[0], dims[1]))?;
            let mut bytes = Vec::new();
            Pages::open(path, 1, length)?.read_to_end(&mut bytes).map_err(|e| e.to_string())?;
            return Ok(Image { dims, element, bytes, palette: Vec::new() });
        }
        let of_bytes = |size| Element::Int { size, signed: false };
        if let Some(Indexed { dims, numbers, palette }) = Indexed::read(path)? {
            return Ok(Image { dims, element: of_bytes(1), bytes: numbers, palette });
        }
        let Grey { dims, bits, values } = Grey::read(path)?;
        let (size, bytes) = match bits {
            8 => (1, values.iter().map(|v| *v as u8).collect()),
            _ => (2, values.iter().flat_map(|v| v.to_ne_bytes()).collect()),
        };
        Ok(Image { dims, element: of_bytes(size), bytes, palette: Vec::new() })
    }
}

/// The labels of all images, one image in memory.
pub(super) struct OneByOne {
    files: Vec<PathBuf>,
    dims: [usize; 2],
    element: Element,
    /// Colours of the images with a palette so far.
    palette: Vec<[u8; 3]>,
    /// Images that were read.
    done: usize,
    /// The image, and how much of it was given away.
    bytes: Vec<u8>,
    used: usize,
}

impl OneByOne {
    /// Images of this size and type.
    pub fn new(files: Vec<PathBuf>, dims: [usize; 2], element: Element) -> Self {
        OneByOne { files, dims, element, palette: Vec::new(), done: 0, bytes: Vec::new(), used: 0 }
    }

    fn next(&mut self, file: usize) -> Failure<()> {
        let image = Image::read(&self.files[file])?;
        if (image.dims, image.element) != (self.dims, self.element) {
            let words = |[w, h]: [usize; 2], element: Element| format!("{w}x{h} px of {}", element.name());
            let (own, first) = (words(image.dims, image.element), words(self.dims, self.element));
            return Err(format!("{own}, but slice 0 has {first}"));
        }
        if let Some((number, (own, first))) =
            image.palette.iter().zip(&self.palette).enumerate().find(|(_, (own, first))| own != first)
        {
            return Err(format!(
                "number {number} of its palette is the colour {own:?}, and {first:?} in slices before it: numbers mean other labels there"
            ));
        }
        if image.palette.len() > self.palette.len() {
            self.palette = image.palette;
        }
        (self.bytes, self.used, self.done) = (image.bytes, 0, file + 1);
        Ok(())
    }
}

impl Read for OneByOne {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.used == self.bytes.len() {
            let file = self.done;
            let Some(path) = self.files.get(file) else { return Ok(0) };
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            self.next(file).map_err(|m| io::Error::other(format!("slice {file} (`{name}`): {m}")))?;
        }
        let n = out.len().min(self.bytes.len() - self.used);
        out[..n].copy_from_slice(&self.bytes[self.used..self.used + n]);
        self.used += n;
        Ok(n)
    }
}
