//! Bytes compressed on all threads into one stream that every reader of gzip (RFC 1952) or zlib (RFC 1950) takes as any other.
//!
//! The bytes are cut into blocks of [`BLOCK`]. Each is deflated (RFC 1951) by itself and ends on a whole byte with an empty stored block (a
//! "sync flush"), so that what the blocks become stands one behind the other. The cuts depend on nothing but the bytes: neither does the file.

use std::io::{self, Write};

use adler2::Adler32;
use flate2::{Compress, Compression, Crc, FlushCompress};
use rayon::prelude::*;

/// Bytes of a block: 8 times the window that deflate looks back in, so that cuts cost little.
const BLOCK: usize = 1 << 18;
/// Blocks that are compressed together, at most.
const TOGETHER: usize = 8;

/// Header of a gzip member: deflate, no name, no time, compressed as fast as can be, from an unknown system.
const GZIP: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 4, 255];
/// Header of a zlib stream: deflate with a window of 32 KiB, compressed as fast as can be; as a big-endian number a multiple of 31.
const ZLIB: [u8; 2] = [0x78, 0x01];

/// Writes what is written to it compressed. Without [`finish`](Self::finish) the stream has no end.
pub struct Deflate<W: Write> {
    out: W,
    header: &'static [u8],
    check: Check,
    waiting: Vec<u8>,
}

/// What stands behind the blocks.
enum Check {
    Crc(Crc),
    Adler(Adler32),
}

impl<W: Write> Deflate<W> {
    /// A gzip member.
    pub fn gzip(out: W) -> Self {
        Deflate { out, header: &GZIP, check: Check::Crc(Crc::new()), waiting: Vec::new() }
    }

    /// A zlib stream.
    pub fn zlib(out: W) -> Self {
        Deflate { out, header: &ZLIB, check: Check::Adler(Adler32::new()), waiting: Vec::new() }
    }

    /// Compresses what waits.
    fn send(&mut self, flush: FlushCompress) -> io::Result<()> {
        match &mut self.check {
            Check::Crc(crc) => crc.update(&self.waiting),
            Check::Adler(adler) => adler.write_slice(&self.waiting),
        }
        self.out.write_all(std::mem::take(&mut self.header))?;
        let blocks = self.waiting.par_chunks(BLOCK).map(|block| deflated(block, FlushCompress::Sync));
        let mut blocks = blocks.collect::<io::Result<Vec<_>>>()?;
        if flush == FlushCompress::Finish {
            blocks.push(deflated(&[], flush)?);
        }
        self.waiting.clear();
        blocks.iter().try_for_each(|block| self.out.write_all(block))
    }

    /// Ends the stream; what it was written to is handed back.
    ///
    /// # Errors
    /// The errors of what it is written to.
    pub fn finish(&mut self) -> io::Result<&mut W> {
        self.send(FlushCompress::Finish)?;
        match &self.check {
            Check::Crc(crc) => {
                self.out.write_all(&crc.sum().to_le_bytes())?;
                self.out.write_all(&crc.amount().to_le_bytes())?;
            }
            Check::Adler(adler) => self.out.write_all(&adler.checksum().to_be_bytes())?,
        }
        Ok(&mut self.out)
    }
}

impl<W: Write> Write for Deflate<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(TOGETHER * BLOCK - self.waiting.len());
        self.waiting.extend_from_slice(&bytes[..taken]);
        if self.waiting.len() == TOGETHER * BLOCK {
            self.send(FlushCompress::Sync)?;
        }
        Ok(taken)
    }

    /// Nothing: a flush between blocks would move their cuts.
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A block as raw deflate, in one call into room for all of it: what does not compress is stored, 5 bytes more for each piece of some KiB. (The end of a flush
/// that finds no room can be lost in a second call.)
fn deflated(block: &[u8], flush: FlushCompress) -> io::Result<Vec<u8>> {
    let mut state = Compress::new(Compression::fast(), false);
    let mut out = Vec::with_capacity(block.len() + block.len() / 64 + 64);
    state.compress_vec(block, &mut out, flush)?;
    if state.total_in() == block.len() as u64 && out.len() < out.capacity() {
        Ok(out)
    } else {
        Err(io::Error::other(format!("{} bytes deflate to more than {} bytes", block.len(), out.capacity())))
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::bufread::{GzDecoder, ZlibDecoder};
    use proptest::prelude::*;

    use super::*;

    /// The stream of some bytes written some at a time, on this many threads.
    fn stream(bytes: &[u8], step: usize, threads: usize, start: fn(Vec<u8>) -> Deflate<Vec<u8>>) -> Vec<u8> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut out = start(Vec::new());
            bytes.chunks(step).for_each(|some| out.write_all(some).unwrap());
            out.finish().unwrap().clone()
        })
    }

    /// Bytes of which some repeat: a share `noise` of 256 does not.
    fn bytes(len: usize, noise: u32, seed: u32) -> Vec<u8> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        (0..len).map(|n| if next() % 256 < noise { next() as u8 } else { (n / 999) as u8 }).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn what_is_written_is_read_again(
            len in prop_oneof![0usize..3, 0..200_000usize, (1usize..4).prop_map(|n| n * BLOCK), Just(TOGETHER * BLOCK), Just(TOGETHER * BLOCK + 1)],
            noise in prop_oneof![Just(0u32), Just(256), 0u32..256],
            step in 1000usize..3_000_000,
            seed: u32,
        ) {
            let given = bytes(len, noise, seed);
            let gzip = stream(&given, step, 2, Deflate::gzip);
            let mut read = Vec::new();
            let mut member = GzDecoder::new(&gzip[..]);
            member.read_to_end(&mut read).unwrap();
            prop_assert!(read == given);
            prop_assert!(member.into_inner().is_empty());
            let zlib = stream(&given, step, 2, Deflate::zlib);
            let mut read = Vec::new();
            let mut decoder = ZlibDecoder::new(&zlib[..]);
            decoder.read_to_end(&mut read).unwrap();
            prop_assert!(read == given);
            prop_assert_eq!(decoder.total_in() as usize, zlib.len());
            let other = stream(&given, 70_000, 1, Deflate::gzip);
            prop_assert!(other == gzip);
        }
    }

    #[test]
    fn a_changed_byte_is_seen() {
        let mut gzip = stream(&bytes(3 * BLOCK, 100, 1), BLOCK, 2, Deflate::gzip);
        let check = gzip.len() - 8;
        gzip[check] ^= 1;
        assert!(GzDecoder::new(&gzip[..]).read_to_end(&mut Vec::new()).is_err());
    }
}
