//! Interrupts: Ctrl-C and its kin (SIGINT, SIGTERM, SIGHUP; the console's events on Windows).

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

fn handle(act: impl FnMut() + Send + 'static) {
    if let Err(e) = ctrlc::set_handler(act) {
        tell!("warning: an interrupt will end the program at once and leave temporary files: {e}");
    }
}
