//! Which mutant is alive: that of the number in `INTERSLICE_MUTANT`; none without it.
//!
//! With `INTERSLICE_REACHED`, a folder, no mutant is alive, and every process writes into a file there the numbers of those that it evaluated.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};

const UNKNOWN: u32 = u32::MAX;
const RECORDING: u32 = u32::MAX - 1;
const MOST: usize = 1 << 17;

static ALIVE: AtomicU32 = AtomicU32::new(UNKNOWN);
static REACHED: [AtomicU8; MOST] = [const { AtomicU8::new(0) }; MOST];
static RECORD: Mutex<Option<File>> = Mutex::new(None);

/// Whether the mutant `number` is the living one.
#[inline(always)]
pub fn is(number: u32) -> bool {
    let alive = ALIVE.load(Ordering::Relaxed);
    alive == number || (alive >= RECORDING && asked(number))
}

#[cold]
#[inline(never)]
fn asked(number: u32) -> bool {
    if ALIVE.load(Ordering::Relaxed) == UNKNOWN {
        let folder = std::env::var_os("INTERSLICE_REACHED");
        let living = std::env::var("INTERSLICE_MUTANT").ok().map(|n| n.parse().expect("INTERSLICE_MUTANT is a number"));
        if let Some(folder) = &folder {
            let name = format!("{}", std::process::id());
            let file = OpenOptions::new().create(true).append(true).open(std::path::Path::new(folder).join(name));
            RECORD.lock().expect("a lock").get_or_insert(file.expect("the folder of INTERSLICE_REACHED is there"));
        }
        ALIVE.store(if folder.is_some() { RECORDING } else { living.unwrap_or(0) }, Ordering::Relaxed);
        return is(number);
    }
    if REACHED[number as usize].swap(1, Ordering::Relaxed) == 0
        && let Some(file) = RECORD.lock().expect("a lock").as_mut()
    {
        file.write_all(format!("{number}\n").as_bytes()).expect("numbers are recorded");
    }
    false
}

/// The text of a shader: `built`, or with `INTERSLICE_SHADERS`, a folder, the files there.
pub fn shader(files: &[&str], built: &'static str) -> &'static str {
    let Some(folder) = std::env::var_os("INTERSLICE_SHADERS") else { return built };
    let read = |file: &&str| std::fs::read_to_string(std::path::Path::new(&folder).join(file)).expect("the shader is there");
    let text: Vec<String> = files.iter().map(read).collect();
    Box::leak((text.join("\n") + "\n").into_boxed_str())
}
