//! What SECURITY.md says of the code: where it is `unsafe`, and that there is no network.

use std::fs;
use std::path::Path;

use crate::{ROOT, sources};

/// Lines of code with `unsafe` in them, and proofs of them.
fn unsafe_lines(text: &str) -> [usize; 2] {
    let code = |l: &&str| {
        l.split("//").next().is_some_and(|code| code.split(|c: char| !c.is_alphanumeric()).any(|w| w == "unsafe"))
    };
    [text.lines().filter(code).count(), text.lines().filter(|l| l.trim_start().starts_with("// SAFETY:")).count()]
}

/// Rows `` | `file` | count | `` of the page on security.
fn listed_unsafe(page: &str) -> Vec<(String, usize)> {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| `")?.split('|');
        let file = cells.next()?.trim().strip_suffix('`')?.to_string();
        Some((file, cells.next()?.trim().parse().ok()?))
    };
    page.lines().filter_map(row).collect()
}

/// SECURITY.md lists every file with `unsafe`; each has a proof beside each, but for functions of a trait that is unsafe as a whole.
#[test]
fn unsafe_code_is_listed_and_proved() {
    let page = fs::read_to_string(Path::new(ROOT).join("SECURITY.md")).expect("it is there");
    let mut found = Vec::new();
    for folder in ["src", "python/src"] {
        for file in sources(&Path::new(ROOT).join(folder)) {
            let text = fs::read_to_string(&file).expect("a text");
            let [places, proofs] = unsafe_lines(&text);
            let of_a_trait = text.lines().filter(|l| l.trim_start().starts_with("unsafe fn")).count();
            let name = file.strip_prefix(ROOT).expect("below the root").display().to_string().replace('\\', "/");
            assert_eq!(
                places - of_a_trait,
                proofs,
                "{name}: {places} places, {of_a_trait} of a trait, {proofs} proofs"
            );
            if places > 0 {
                found.push((name, places));
            }
        }
    }
    found.sort();
    let mut listed = listed_unsafe(&page);
    listed.sort();
    assert_eq!(found, listed);
    assert_eq!(unsafe_lines("// SAFETY: so.\nunsafe { f() } // unsafe\nlet unsafely = 1;\nunsafe impl X {}"), [2, 1]);
}

/// Crates that open connections.
const OF_NETWORKS: [&str; 14] = [
    "curl",
    "curl-sys",
    "h2",
    "hyper",
    "mio",
    "native-tls",
    "openssl",
    "openssl-sys",
    "quinn",
    "reqwest",
    "rustls",
    "socket2",
    "tokio",
    "ureq",
];

/// The program has no connection to a network and starts no other, as SECURITY.md says.
#[test]
fn nothing_of_a_network_is_in_the_program() {
    let named = |text: &str| ["std::net", "std::process::Command", "process::Command"].iter().any(|w| text.contains(w));
    for folder in ["src", "python/src"] {
        for file in sources(&Path::new(ROOT).join(folder)) {
            assert!(!named(&fs::read_to_string(&file).expect("a text")), "{}", file.display());
        }
    }
    assert!(named("use std::net::TcpStream;"));
    let page = fs::read_to_string(Path::new(ROOT).join("docs/soup.md")).expect("it is there");
    let of_program = |page: &str| {
        let rows = page.lines().filter_map(|l| l.strip_prefix("| ").map(|l| l.split(" | ").collect::<Vec<_>>()));
        let mut rows = rows.filter(|cells| cells.get(3) == Some(&"program")).map(|cells| cells[0].to_string());
        rows.any(|name| OF_NETWORKS.contains(&&*name))
    };
    assert!(page.contains("| program |") && !of_program(&page));
    assert!(of_program(&page.replacen("| adler2 |", "| ureq |", 1)));
}
