//! The command line: arguments to settings to `reconstruct` to files. No numerics.

#[macro_use]
mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    quiet_drivers();
    match cli::run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

/// Without a desktop, Mesa's layer that ranks GPUs by the desktop's choice says on stderr that it found none; nobody needs to read that.
fn quiet_drivers() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() && std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: the first statement of the program: there is no other thread that could read the environment meanwhile.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
