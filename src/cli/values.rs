//! Values of options: negative numbers are values and no options, and what is no number is told in words.

use std::any::TypeId;
use std::ffi::OsString;

use clap::error::ErrorKind;
use clap::{Arg, Command};

/// An option whose values may begin with a minus sign, where it takes numbers, lists of them, or one of some words.
pub fn told(option: Arg) -> Arg {
    if option.is_positional() || !option.get_action().takes_values() {
        return option;
    }
    let of = option.get_value_parser().type_id();
    let option = if of == TypeId::of::<f64>() {
        option.value_parser(number)
    } else if of == TypeId::of::<usize>() {
        option.value_parser(count)
    } else if of == TypeId::of::<i64>() {
        option.value_parser(whole)
    } else if option.get_possible_values().is_empty() {
        return option;
    } else {
        option
    };
    // Not `allow_negative_numbers`, which knows neither `-1,2` nor `-1e-3`, nor says of `--axis -z` which axes there are.
    option.allow_hyphen_values(true)
}

/// An error where an option whose value is missing has taken the option behind it for its value, as those that allow a minus sign would.
pub fn swallowed(command: &mut Command, arguments: impl Iterator<Item = OsString>) -> Option<clap::Error> {
    let arguments: Vec<String> = arguments.map(|text| text.to_string_lossy().into_owned()).collect();
    let command = command.find_subcommand_mut(arguments.get(1)?)?;
    let is = |option: &Arg, text: &str| {
        let long = text.strip_prefix("--").is_some_and(|name| option.get_long() == Some(name));
        long || text.strip_prefix('-').is_some_and(|name| option.get_short().is_some_and(|c| name == c.to_string()))
    };
    let before = arguments.iter().position(|text| text == "--").unwrap_or(arguments.len());
    let message = arguments[..before].windows(2).find_map(|pair| {
        let option = |text: &str| command.get_arguments().find(|option| is(option, text));
        option(&pair[0]).filter(|option| option.is_allow_hyphen_values_set())?;
        option(&pair[1])?;
        Some(format!("{0} lacks its value: {1}, which follows it, is an option", pair[0], pair[1]))
    })?;
    // Without it the usage names no command.
    command.build();
    Some(command.error(ErrorKind::InvalidValue, message))
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| "expected a number".into())
}

fn count(text: &str) -> Result<usize, String> {
    text.trim().parse().map_err(|_| "expected a whole number, 0 or more".into())
}

fn whole(text: &str) -> Result<i64, String> {
    text.trim().parse().map_err(|_| "expected a whole number".into())
}
