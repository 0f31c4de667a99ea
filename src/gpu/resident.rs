//! Images of the host's fields that stay on the device: sent once, copied by the device to where a stage wants them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use super::Gpu;
use super::buffer::Buffer;
use super::moving::bounded;
use super::recorder::Recorder;
use crate::error::Result;
use crate::grid::field::Field;

/// Share of the budget that images may take.
const SHARE: f64 = 0.1;

/// Images by the fields they were made of.
#[derive(Debug, Default)]
pub struct Resident {
    images: Mutex<Vec<Image>>,
    /// The device has once had no memory: nothing stays there any more.
    short: AtomicBool,
}

#[derive(Debug)]
struct Image {
    /// As long as this is held nothing else has the field's address.
    field: Weak<Field>,
    /// Bits of the number that its values were multiplied with.
    scale: u64,
    values: Arc<Buffer<[f32]>>,
}

/// Values of a field as a kernel reads them.
pub fn scaled(field: &Field, scale: f64) -> impl Iterator<Item = f32> + '_ {
    field.data.iter().map(move |v| bounded(scale * v))
}

impl Resident {
    /// Lets the images of fields go that are no more, for whoever needs buffers like them.
    pub fn sweep(&self) {
        let mut images = self.images.lock().unwrap_or_else(PoisonError::into_inner);
        images.retain(|image| image.field.strong_count() > 0);
    }
}

impl Gpu {
    /// Lets everything go on the device that no stage needs, images of fields and all that waits for a user: there was no memory. From now on no
    /// image stays.
    ///
    /// # Errors
    /// The errors of [`Device::wait`](super::device::Device::wait).
    pub(super) fn release(&self) -> Result<()> {
        self.resident.short.store(true, Ordering::Relaxed);
        self.resident.images.lock().unwrap_or_else(PoisonError::into_inner).clear();
        self.device.release()
    }

    /// Records that the values of `field`, times `scale`, are copied to `target` from the value `first` on.
    pub(super) fn place(
        &self,
        recorder: &mut Recorder<'_>,
        (field, scale): (&Arc<Field>, f64),
        (target, first): (&Buffer<[f32]>, usize),
    ) -> Result<()> {
        let image = self.image(field, scale)?;
        let bytes = size_of_val(&field.data[..]) as u64 / 2;
        recorder.copy_part((&image, 0), (target, 4 * first as u64), bytes);
        Ok(())
    }

    /// The image of a field, which stays as long as the field and there is room.
    fn image(&self, field: &Arc<Field>, scale: f64) -> Result<Arc<Buffer<[f32]>>> {
        let images = || self.resident.images.lock().unwrap_or_else(PoisonError::into_inner);
        let known = |image: &Image| image.scale == scale.to_bits() && image.field.as_ptr() == Arc::as_ptr(field);
        {
            let mut images = images();
            images.retain(|image| image.field.strong_count() > 0);
            if let Some(at) = images.iter().position(known) {
                // The one that nobody has asked for for the longest time is the first.
                let image = images.remove(at);
                let values = image.values.clone();
                images.push(image);
                return Ok(values);
            }
        }
        let count = field.data.len();
        let most = (SHARE * self.device.budget() as f64) as usize / (count * size_of::<f32>()).max(1);
        {
            let mut images = images();
            let too_many = (images.len() + 1).saturating_sub(most).min(images.len());
            images.drain(..too_many);
        }
        // While others compute nobody may wait for the images.
        let make = |first: usize, out: &mut [f32]| {
            out.iter_mut().zip(&field.data[first..]).for_each(|(to, v)| *to = bounded(scale * v));
        };
        let values = Arc::new(self.device.upload_made("field", count, make)?);
        if most > 0 && !self.resident.short.load(Ordering::Relaxed) {
            images().push(Image { field: Arc::downgrade(field), scale: scale.to_bits(), values: values.clone() });
        }
        Ok(values)
    }
}
