//! Interrupts: Ctrl-C and its kin (SIGINT, SIGTERM, SIGHUP; the console's events on Windows), and the signal of files that grow too large.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use interslice::storage::temporaries::remove_and_exit;

/// Exit code of a program that was interrupted, as shells have it.
const INTERRUPTED: i32 = 130;

/// Any interrupt removes the temporary files and ends the program.
pub fn end() {
    handle(|| {
        tell!("\ninterrupted; unfinished outputs are removed");
        remove_and_exit(INTERRUPTED)
    });
}

/// Set by the first interrupt; the second ends the program.
pub fn stop() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    handle(move || {
        if flag.swap(true, Ordering::Relaxed) {
            remove_and_exit(INTERRUPTED);
        }
        tell!("finishing the jobs that run; interrupt again to drop them");
    });
    stop
}

/// Lets a write beyond the limit of a file's size (`ulimit -f`) fail as any other write does: its signal (SIGXFSZ) would end the program at once and
/// leave temporary files.
#[cfg(unix)]
pub fn let_large_files_fail() {
    // SAFETY: `signal` takes the number of a signal and what to do, both constants of the system; it reads and writes no memory of the program, and
    // `SIG_IGN` is no handler, so no code of ours runs inside a signal. The disposition is the process's: no other code here sets that of this signal.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}

#[cfg(not(unix))]
pub fn let_large_files_fail() {}

fn handle(act: impl FnMut() + Send + 'static) {
    if let Err(e) = ctrlc::set_handler(act) {
        tell!("warning: an interrupt will end the program at once and leave temporary files: {e}");
    }
}
