//! `interslice man`.

use clap_mangen::Man;
use interslice::{Error, Result};

use super::command;
use super::say::say_exactly;

#[derive(Debug, clap::Args)]
pub struct ManArguments {
    /// Command whose page is printed, such as reconstruct [default: the program's own page]
    command: Option<String>,
}

pub fn run(arguments: &ManArguments) -> Result<()> {
    let mut root = command();
    root.build();
    let page = match &arguments.command {
        None => root,
        Some(name) => named(&root, name)?,
    };
    let mut text = Vec::new();
    let source = concat!("interslice ", env!("CARGO_PKG_VERSION"));
    Man::new(page)
        .source(source)
        .render(&mut text)
        .map_err(|source| Error::Write { path: "man page".into(), source })?;
    say_exactly(&String::from_utf8_lossy(&text))
}

/// The subcommand of that name; its page is called `interslice-reconstruct`.
fn named(root: &clap::Command, name: &str) -> Result<clap::Command> {
    let Some(found) = root.find_subcommand(name) else {
        let names: Vec<&str> = root.get_subcommands().map(clap::Command::get_name).filter(|n| *n != "help").collect();
        let message = format!("must be one of {}; got `{name}`", names.join(", "));
        return Err(Error::Setting { name: "command".into(), message });
    };
    Ok(found.clone())
}
