//! The program: the command line of `interslice::cli`, on an allocator of its own.

use std::process::ExitCode;

use interslice::cli;

/// Large arrays on large pages.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[global_allocator]
static ALLOCATOR: cli::OnLargePages = cli::OnLargePages;

fn main() -> ExitCode {
    quiet_drivers();
    ExitCode::from(cli::main(std::env::args_os()))
}

/// Without a desktop, Mesa's layer that ranks GPUs by the desktop's choice says on stderr that it found none; nobody needs to read that.
fn quiet_drivers() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() && std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: the first statement of the program: there is no other thread that could read the environment meanwhile.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
