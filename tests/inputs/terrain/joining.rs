//! Pieces of lines that are joined, gaps that are closed, and lines that cannot be.

use serde_json::Value;

use super::maps::*;

#[test]
fn pieces_of_a_line_are_joined_whatever_their_direction() {
    let whole = circle([0.0, 0.0], 300.0);
    let mut piece = whole[40..=80].to_vec();
    piece.reverse();
    // Half a pixel is 5: the ends of the second piece lie 3 off.
    let moved = whole[80..=120].iter().map(|p| [p[0] + 3.0, p[1]]).collect();
    let outer = circle([0.0, 0.0], 400.0);
    let point = [EAST + 1.0, NORTH];
    let pieces = [
        feature(100, &outer),
        feature(150, &whole[0..=40].to_vec()),
        feature(150, &moved),
        feature(150, &piece),
        feature(100, &outer.iter().rev().copied().collect()),
        feature(150, &vec![point, [EAST + 2.0, NORTH], point]),
    ];
    let terrain = read(&pieces, &pixels(10.0));
    assert!(
        inside(&terrain, 1, [0.0, 0.0]) && inside(&terrain, 1, [0.0, -290.0]) && !inside(&terrain, 1, [0.0, 320.0])
    );
    assert!(terrain.notes.iter().any(|n| n.contains("feature 5: the same line")), "{:?}", terrain.notes);
    assert!(terrain.notes.iter().any(|n| n.contains("feature 6: a line of 150 is a point")), "{:?}", terrain.notes);
}

/// Programs that draw contours leave many lines of no length, where heights are those of a level.
#[test]
fn of_many_lines_of_no_length_some_are_told_one_by_one() {
    let point = |k: usize| feature(100, &vec![[EAST + 10.0 * k as f64, NORTH]; 2]);
    let lines: Vec<Value> =
        cone().into_iter().chain((0..40).map(point)).chain((0..5).map(|_| cone()[0].clone())).collect();
    let notes = read(&lines, &pixels(20.0)).notes;
    let of = |words: &str| notes.iter().filter(|n| n.contains(words)).count();
    assert_eq!(
        (of("is a point or encloses nothing"), of("37 more lines are points or enclose nothing")),
        (3, 1),
        "{notes:?}"
    );
    assert_eq!((of("is there before"), of("2 more lines are there before; left out")), (3, 1), "{notes:?}");
}

/// A gap of a line up to two pixels long is closed straight, and told; none where another end might be meant.
#[test]
fn short_gaps_of_lines_are_closed_where_nothing_else_is_near() {
    let (outer, ring) = (circle([0.0, 0.0], 400.0), circle([0.0, 0.0], 200.0));
    let (whole, gap) = (ring.clone(), ring[1..ring.len() - 2].to_vec());
    let [first, last] = [gap[0], gap[gap.len() - 1]];
    let long = (first[0] - last[0]).hypot(first[1] - last[1]);
    assert!(long > 30.0 && long < 40.0, "{long}");
    let map = |line: &Line| read(&[feature(100, &outer), feature(150, line)], &pixels(20.0));
    let (closed, given) = (map(&gap), map(&whole));
    let told = format!("1 gap of a line is closed straight, no other end being near: up to {long:.3} long");
    assert!(closed.notes.iter().any(|n| n.contains(&told)), "{:?}", closed.notes);
    assert!(given.notes.iter().all(|n| !n.contains("closed straight")), "{:?}", given.notes);
    for at in [[190.0, 0.0], [170.0, 8.0], [-190.0, 0.0], [230.0, 0.0], [0.0, 0.0]] {
        assert_eq!(inside(&closed, 1, at), inside(&given, 1, at), "{at:?}");
    }
    // One point more is missing.
    let wide = refused(&[feature(100, &outer), feature(150, &ring[1..ring.len() - 3].to_vec())], &[]);
    assert_says(
        &wide,
        &["ends inside the map", "within 10.0000 (half a pixel), and within 40.0000 where no third one is near"],
    );
    // A piece of a line begins near the gap: which ends belong together?
    let piece: Line = [[240.0, 0.0], [260.0, 0.0]].map(|[x, y]| [EAST + x, NORTH + y]).to_vec();
    let said = refused(&[feature(100, &outer), feature(150, &gap), feature(150, &piece)], &[]);
    assert_says(&said, &["4 ends of lines meet nothing"]);
}

#[test]
fn lines_that_dangle_or_cross_are_named() {
    let dangling = [feature(100, &circle([0.0, 0.0], 400.0)), feature(150, &circle([0.0, 0.0], 200.0)[..90].to_vec())];
    let said = refused(&dangling, &[]);
    assert_says(&said, &["feature 2", "line of 150", "ends inside the map at (500200, 4000000)", "away", "within 10"]);
    assert_says(
        &said,
        &["2 ends of lines meet nothing. feature 2", "What to try", "--border hull", "--pixel 580.2995"],
    );
    let crossing = [feature(100, &circle([0.0, 0.0], 400.0)), feature(150, &circle([300.0, 0.0], 200.0))];
    assert_says(&refused(&crossing, &[]), &["feature", "150", "100", "cross", "more than 20"]);
    // A summit outside the level below: a line around it is missing.
    let mut missing = cone();
    missing.push(feature(200, &circle([800.0, 0.0], 100.0)));
    assert_says(&refused(&missing, &[]), &["feature 5", "line of 200", "missing"]);
}

/// As hands draw them: told, not refused, where it is by a pixel at most, or of one elevation.
#[test]
fn lines_that_cross_are_told() {
    let outer = feature(100, &circle([0.0, 0.0], 400.0));
    // A line that goes on beyond its first point, over its own begin.
    let mut drawn_on: Line = circle([0.0, 0.0], 300.0);
    drawn_on.truncate(118);
    drawn_on.extend([[EAST + 310.0, NORTH + 5.0], [EAST + 290.0, NORTH + 40.0]]);
    drawn_on.push(drawn_on[0]);
    // One that comes 3 beyond the line around it, of pixels of 10.
    let mut bulge = circle([0.0, 0.0], 200.0);
    let near = circle([0.0, 0.0], 303.0);
    bulge.splice(60..61, [near[60]]);
    let told = |features: &[Value]| -> Vec<String> {
        let crossing = |note: &&String| note.contains("lines cross") || note.contains("elevations cross");
        read(features, &pixels(10.0)).notes.iter().filter(crossing).cloned().collect()
    };
    let notes = told(&[outer.clone(), feature(150, &drawn_on), feature(200, &circle([0.0, 0.0], 100.0))]);
    let [own] = &notes[..] else { panic!("{notes:?}") };
    assert_says(
        own,
        &["lines cross themselves or others of their elevation at 1 place, the first at (5002", "(feature 2 of 150): "],
    );
    let notes = told(&[outer.clone(), feature(150, &circle([0.0, 0.0], 300.0)), feature(200, &bulge)]);
    let [others] = &notes[..] else { panic!("{notes:?}") };
    assert_says(
        others,
        &[
            "lines of different elevations cross at 2 places, the first at (499700",
            "(feature 2 of 150 and feature 3 of 200): by no more than a pixel",
        ],
    );
    assert_eq!(told(&cone()), Vec::<String>::new());
}
