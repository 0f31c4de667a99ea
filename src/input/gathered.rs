//! Folders whose files need no names: all of a kind are the input, and what is laid beside them joins them.

use std::path::Path;

use super::contents::{Contents, is_image};
use super::folder::is_of_images;
use super::format::InputFormat;
use super::sniff;

/// What the files of such a folder are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Gathered {
    /// Images of a slice each.
    Slices,
    /// Volumes of a label each.
    Masks,
}

impl Gathered {
    /// Of a folder; nothing for any other input.
    pub fn of(path: &Path) -> Option<Self> {
        if !path.is_dir() || path.join("stack.json").is_file() || sniff::is_zarr(path) || sniff::has_dicom(path) {
            return None;
        }
        match Contents::of(path).is_ok_and(|contents| contents.is_of_masks()) {
            true => Some(Gathered::Masks),
            false => is_of_images(path).then_some(Gathered::Slices),
        }
    }

    /// Whether a file of this name would be one of them.
    pub fn takes(self, name: &str) -> bool {
        // A Zarr is a folder itself.
        let is_volume = |format: &InputFormat| format.is_volume() && format.name != "zarr";
        match self {
            _ if name.starts_with('.') => false,
            Gathered::Slices => is_image(Path::new(name)),
            Gathered::Masks => InputFormat::of_name(name).is_some_and(|(format, _)| is_volume(format)),
        }
    }

    /// One of them.
    pub fn one(self) -> &'static str {
        match self {
            Gathered::Slices => "a slice",
            Gathered::Masks => "a mask",
        }
    }
}
