//! Help, completions and man pages.

use crate::files::*;

#[test]
fn help_names_every_setting_with_its_default() {
    let result = interslice(&["reconstruct", "--help"]);
    let text = String::from_utf8_lossy(&result.stdout).into_owned();
    for part in ["--cfl <NUMBER>", "[default: 0.5]", "--slope", "[default: hyman]", "--end-top", "[default: flat]"] {
        assert!(text.contains(part), "`{part}` is missing");
    }
}

/// Headings of a help text, each with the long options under it.
fn groups(text: &str) -> Vec<(String, Vec<String>)> {
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_suffix(':').filter(|l| !l.starts_with(' ')) {
            groups.push((heading.into(), Vec::new()));
        }
        let flag = Some(line.trim_start()).filter(|l| l.starts_with('-'));
        let option = flag.and_then(|l| l.split_once("--")).and_then(|(_, name)| name.split_whitespace().next());
        if let (Some(option), Some((_, options))) = (option, groups.last_mut()) {
            options.push(option.into());
        }
    }
    groups
}

#[test]
fn help_is_grouped_and_begins_with_the_output() {
    let help = |command: &str| {
        let result = interslice(&[command, "-h"]);
        assert_eq!(result.status.code(), Some(0), "{command}");
        groups(&String::from_utf8_lossy(&result.stdout))
    };
    let headings = |command: &str| help(command).into_iter().map(|(heading, _)| heading).collect::<Vec<_>>();
    let all = ["Arguments", "Options", "Input", "Output", "Method", "Ends", "Machine"];
    for (command, expected) in [
        ("reconstruct", all.to_vec()),
        ("plan", all.to_vec()),
        ("run", all.to_vec()),
        ("evaluate", all.into_iter().filter(|h| *h != "Output").collect()),
        ("inspect", vec!["Arguments", "Options", "Input"]),
        ("merge", vec!["Arguments", "Options", "Output"]),
        ("batch", vec!["Arguments", "Options", "Template", "Machine"]),
    ] {
        assert_eq!(headings(command), expected, "{command}");
    }
    for command in ["reconstruct", "run", "merge"] {
        let (_, options) = &help(command)[1];
        assert_eq!(options.first().map(String::as_str), Some("output"), "{command}: {options:?}");
        assert!(options.contains(&"quiet".to_string()), "{command}: {options:?}");
    }
    let reconstruct = help("reconstruct");
    for (heading, options) in [
        ("Input", &["level", "label", "labels", "links"][..]),
        ("Output", &["dz", "mask", "keep-overlaps"]),
        ("Method", &["method", "fair", "slope", "cfl"]),
        ("Ends", &["end-bottom", "end-top", "cap-gaps", "clamp-bottom", "clamp-top"]),
        ("Machine", &["backend", "memory", "threads"]),
    ] {
        let (_, found) = reconstruct.iter().find(|(h, _)| h == heading).expect("the heading is there");
        let missing: Vec<_> = options.iter().filter(|o| !found.iter().any(|f| f == *o)).collect();
        assert!(missing.is_empty(), "{heading}: {missing:?} of {found:?}");
    }
    let ends = &reconstruct.iter().find(|(h, _)| h == "Ends").expect("the heading is there").1;
    assert_eq!(ends.len(), 5, "{ends:?}");
    assert_eq!(ends[0], "end-bottom", "rules stand before slopes");
}

#[test]
fn completions_know_commands_and_options() {
    for (shell, said) in [
        ("bash", "complete -F _interslice"),
        ("zsh", "#compdef interslice"),
        ("fish", "complete -c interslice"),
        ("elvish", "edit:completion:arg-completer[interslice]"),
        ("powershell", "Register-ArgumentCompleter"),
    ] {
        let result = interslice(&["completions", shell]);
        let text = String::from_utf8_lossy(&result.stdout).into_owned();
        assert_eq!(result.status.code(), Some(0), "{shell}: {}", stderr(&result));
        for part in [said, "reconstruct", "end-top", "completions"] {
            assert!(text.contains(part), "{shell}: `{part}` is missing");
        }
    }
    let unknown = interslice(&["completions", "csh"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("bash"), "{}", stderr(&unknown));
}

#[test]
fn every_command_has_a_man_page() {
    let page = |arguments: &[&str]| {
        let result = interslice(&[&["man"], arguments].concat());
        assert_eq!(result.status.code(), Some(0), "{arguments:?}: {}", stderr(&result));
        String::from_utf8_lossy(&result.stdout).replace('\\', "")
    };
    let root = page(&[]);
    assert!(root.contains(".TH interslice 1") && root.contains(".SH SUBCOMMANDS"), "{root}");
    let named = root.lines().filter_map(|l| l.strip_prefix("interslice-")?.strip_suffix("(1)"));
    let commands: Vec<&str> = named.filter(|c| *c != "help").collect();
    assert!(commands.contains(&"reconstruct") && commands.contains(&"man") && commands.len() >= 10, "{commands:?}");
    for command in commands {
        let text = page(&[command]);
        let title = format!(".TH interslice-{command} 1  \"interslice {}\"", env!("CARGO_PKG_VERSION"));
        assert!(text.contains(&title), "{command}: {}", &text[..text.len().min(200)]);
    }
    let reconstruct = page(&["reconstruct"]);
    for part in [".SH INPUT", ".SH METHOD", ".SH ENDS", ".SH MACHINE", "--end-top", "[default: 0.5]"] {
        assert!(reconstruct.contains(part), "`{part}` is missing");
    }
    let unknown = interslice(&["man", "nosuch"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("reconstruct") && stderr(&unknown).contains("nosuch"), "{}", stderr(&unknown));
}
