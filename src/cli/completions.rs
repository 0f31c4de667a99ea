//! `interslice completions`.

use clap_complete::Shell;
use interslice::Result;

use super::command;
use super::say::say_exactly;

#[derive(Debug, clap::Args)]
pub struct CompletionsArguments {
    /// Shell that completes
    shell: Shell,
}

pub fn run(arguments: &CompletionsArguments) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut command(), "interslice", &mut text);
    say_exactly(&String::from_utf8_lossy(&text))
}
