//! The page of a report: whatever names it shows, and what it says.

use std::fs;

use crate::files::folder;
use crate::written::{cone, write};
use interslice::files::options::OutputOptions;
use interslice::files::outputs::Outputs;
use interslice::files::pending::Temporary;
use interslice::files::places::Places;
use interslice::files::{JobOptions, Loaded};
use interslice::progress::Silent;
use interslice::{Budget, Means, Reference, Settings};

#[test]
fn a_page_survives_hostile_names() {
    let place = folder();
    let mut stack = cone();
    stack.slices[0].name = "<script>alert(1)</script>.png".into();
    stack.slices[1].name = "\"><img src=x onerror=alert(2)>{{settings}}".into();
    stack.slices[2].name = "</script><!-- &lt; '".into();
    stack.unit = "<b>mm</b>".into();
    let name = "a<script>alert(3)<&{{scene}}.html";
    write(place.path(), &stack, &Settings::default(), OutputOptions::default(), &[name]);
    let page = fs::read_to_string(place.path().join(name)).expect("it was written");
    assert_eq!(page.matches("<script").count(), 2, "the page's own: its numbers and its viewer");
    assert_eq!(page.matches("</script").count(), 2);
    for wrong in ["alert(1)</", "<img", "<b>mm", "<!-- &lt;", "https:", "src=\""] {
        assert!(!page.contains(wrong), "{wrong}");
    }
    for right in [
        "&lt;script&gt;alert(1)&lt;/script&gt;.png</button>",
        "&quot;&gt;&lt;img src=x onerror=alert(2)&gt;{{settings}}</button>",
        "<h1>a&lt;script&gt;alert(3)&lt;&amp;{{scene}}</h1>",
        "&lt;b&gt;mm&lt;/b&gt;³",
        "Everything holds that was checked.",
    ] {
        assert!(page.contains(right), "{right}");
    }
}

#[test]
fn a_page_says_which_contours_are_not_met() {
    let place = folder();
    let stack = cone();
    let loaded = Loaded::new(stack, JobOptions::default()).expect("the stack is sound");
    let path = place.path().join("x.html");
    let mut outputs =
        Outputs::open(&[], Some(&path), Temporary::Random, &mut Places::default()).expect("the folder is there");
    let budget = Budget::unlimited();
    let means = Means { backend: &Reference, progress: &Silent, budget: &budget };
    let mut body = loaded.compute(&means, &mut outputs).expect("it can be computed");
    body.report.contours[2].differing_pixels = 17;
    body.report.judge();
    outputs.complete(&mut body.report).expect("it can be written");
    outputs.rename().expect("it can be renamed");
    let page = fs::read_to_string(path).expect("--report takes a page too");
    assert!(page.contains("1 of 4 contours are not met, by 17 pixels.") && page.contains(r#"<td class="off">17</td>"#));
}

#[cfg(feature = "simplify")]
#[test]
fn a_page_says_that_its_figures_are_not_those_of_the_simplified_mesh() {
    let place = folder();
    for (simplify, said) in [(None, false), (Some(0.25), true)] {
        let output = OutputOptions { simplify, ..OutputOptions::default() };
        write(place.path(), &cone(), &Settings::default(), output, &["a.html", "a.stl"]);
        let page = fs::read_to_string(place.path().join("a.html")).expect("it was written");
        assert_eq!(page.contains("those of the mesh before it was simplified"), said);
    }
}

#[test]
fn a_page_tells_where_the_body_ends_and_not_its_layers() {
    let place = folder();
    let mut stack = cone();
    let last = stack.slices.len() - 1;
    stack.slices[last].content = interslice::stack::SliceContent::Mask((0..64 * 60).map(|_| false).collect());
    let report = write(place.path(), &stack, &Settings::default(), OutputOptions::default(), &["a.html", "a.ply"]);
    let page = fs::read_to_string(place.path().join("a.html")).expect("it was written");
    let said = page.split_once("Body from height</dt><dd>").expect("it says so").1;
    let highest: f64 = said.split(' ').nth(2).and_then(|n| n.parse().ok()).expect("a number");
    // The last painted slice lies at 6, the empty one at 9.
    assert!(highest > 6.5 && highest < 8.5, "{said:.40}");
    let beyond = report.areas.expect("a report has them").layers.into_iter().filter(|[z, _]| *z > highest + 1e-3);
    assert!(beyond.map(|[_, area]| area).sum::<f64>() == 0.0);
}
