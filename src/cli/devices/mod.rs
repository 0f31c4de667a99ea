//! Choice of the machine: `--backend`, `--adapter`, `--memory`, `--profile`, and the subcommands `devices` and `doctor`.

mod chosen;
mod doctor;
mod list;
mod options;
mod profile;
mod search;
mod shared;

pub use self::chosen::{ChosenDevice, choose};
pub use self::doctor::examine;
pub use self::list::list;
pub use self::options::DeviceOptions;
pub use self::shared::share;
