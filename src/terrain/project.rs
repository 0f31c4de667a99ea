//! Coordinates of one system in another. proj4rs does the mathematics, in Rust alone, with the definitions of the EPSG registry; without grids of
//! datum shifts, so that old systems such as NAD27 may be refused.

use glam::DVec2;
use proj4rs::Proj;
use proj4rs::transform::transform;

use super::Check;
use super::lines::ContourLine;
use crate::polygons::grid::bounds;
use crate::surface::map::Crs;

/// Longitude and latitude on WGS 84.
pub const WGS84: u32 = 4326;
/// Geographic systems by words of their names, for texts without a code.
const NAMED: [(&str, u32); 5] =
    [("WGS_1984", WGS84), ("WGS 84", WGS84), ("NORTH_AMERICAN_1983", 4269), ("NAD83", 4269), ("ETRS", 4258)];
/// Codes of UTM zone 0, north and south; degrees of longitude of a zone, and most that a map in one may have.
const UTM: [u32; 2] = [32600, 32700];
const ZONE: f64 = 6.0;
const WIDEST: f64 = 12.0;
/// Longitudes and latitudes of any map, and longitudes of one that goes on beyond 180 degrees or counts from 0 to 360.
const ON_EARTH: DVec2 = DVec2::new(180.0, 90.0);
const BEYOND: f64 = 360.0;
/// Web Mercator, and the radius of its sphere, m.
const WEB_MERCATOR: (u32, f64) = (3857, 6_378_137.0);
/// Share by which lengths may be off.
const STRETCHED: f64 = 0.01;
/// Latitudes between which there is UTM.
const LATITUDES: [f64; 2] = [-80.0, 84.0];

/// Turns the lines into another system: that of `out`, else, where they are in degrees, the UTM zone of their middle. Which system they are in now, and
/// a note for a person where it is another.
///
/// # Errors
/// A message with code, feature, coordinates and way out.
pub fn project(lines: &mut [ContourLine], from: Crs, out: Option<&str>) -> Check<(Crs, Option<String>)> {
    let to = match out {
        Some(name) => match Crs::named(name) {
            Some(crs @ Crs::Epsg(code)) if !crs.is_geographic() => code,
            Some(Crs::Epsg(code)) => {
                return Err(format!("`crs_out` must be a system of lengths, as heights are; EPSG:{code} has degrees"));
            }
            _ => return Err(format!("`crs_out` must be EPSG:N with 1024 <= N < 32767; got `{name}`")),
        },
        None if from.is_geographic() => zone(lines)?,
        None => return Ok((from, None)),
    };
    let code = match &from {
        Crs::Epsg(code) => *code,
        Crs::Wkt(wkt) if from.is_geographic() => {
            let upper = wkt.to_uppercase();
            let known = NAMED.iter().find(|(name, _)| upper.contains(name)).map(|(_, code)| *code);
            known.ok_or_else(|| format!("the system of degrees `{}` is not known; --crs EPSG:N names it", name(wkt)))?
        }
        Crs::Wkt(wkt) => {
            return Err(format!("`crs_out` needs the code of the file's system `{}`: --crs EPSG:N", name(wkt)));
        }
        Crs::Unknown | Crs::Local => return Err("`crs_out` needs the system of the file: --crs EPSG:N names it".into()),
    };
    if code == to {
        return Ok((Crs::Epsg(to), None));
    }
    let [source, target] = [system(code)?, system(to)?];
    for line in lines.iter_mut() {
        for point in &mut line.points {
            let DVec2 { x, y } = *point;
            let wrong = |why: String| {
                format!("{}: ({x}, {y}) cannot be turned from EPSG:{code} into EPSG:{to}: {why}", line.feature)
            };
            if source.is_latlong() && !(x.abs() <= BEYOND && y.abs() <= ON_EARTH.y) {
                return Err(wrong("longitude and latitude must lie in [-360, 360] and [-90, 90]".into()));
            }
            let turn = if source.is_latlong() { 1f64.to_radians() } else { 1.0 };
            let mut at = (x * turn, y * turn, 0.0);
            transform(&source, &target, &mut at).map_err(|e| wrong(e.to_string()))?;
            *point = DVec2::new(at.0, at.1);
            if !point.is_finite() {
                return Err(wrong("it has no place there".into()));
            }
        }
    }
    let degrees = if source.is_latlong() { "longitude and latitude" } else { "coordinates" };
    let words = match (out, UTM.iter().find(|zone| (1..=60).contains(&to.wrapping_sub(**zone)))) {
        (None, Some(zone)) => {
            let side = if *zone == UTM[0] { 'N' } else { 'S' };
            format!(", WGS 84 / UTM zone {}{side}; --crs-out EPSG:N names another", to - zone)
        }
        _ => String::new(),
    };
    Ok((Crs::Epsg(to), Some(format!("{degrees} (EPSG:{code}) are reprojected to EPSG:{to}{words}"))))
}

/// Whether coordinates of which nobody says what they are look like longitudes and latitudes. Beyond 180 degrees only where the map is no wider than a
/// UTM zone can hold: plans of buildings and gardens, in metres from a corner, have such coordinates too.
pub fn like_degrees(lines: &[ContourLine]) -> bool {
    let [low, high] = bounds(lines.iter().flat_map(|line| &line.points));
    let far = low.abs().max(high.abs());
    far.cmple(ON_EARTH).all() || (far.x <= BEYOND && far.y <= ON_EARTH.y && high.x - low.x <= WIDEST)
}

/// Note on a system that is given where the file names another.
pub fn contradiction(named: &Crs, given: &Crs) -> Option<String> {
    let own = match named {
        Crs::Epsg(code) => format!("EPSG:{code}"),
        // Whose code is not known may be the one that is given, but not where one has degrees and the other lengths.
        Crs::Wkt(wkt) if named.is_geographic() != given.is_geographic() => format!("`{}`", name(wkt)),
        Crs::Wkt(_) | Crs::Unknown | Crs::Local => return None,
    };
    let given = match given {
        Crs::Epsg(code) => format!("EPSG:{code}"),
        _ => "local".into(),
    };
    (own != given).then(|| format!("`crs` is {given}, but the file names {own}: coordinates are taken as `crs` says"))
}

/// Code of the UTM zone of the middle of the lines.
fn zone(lines: &[ContourLine]) -> Check<u32> {
    let [low, high] = bounds(lines.iter().flat_map(|line| &line.points));
    let ask = "--crs-out EPSG:N names a system of lengths for it";
    let (wide, DVec2 { x, y }) = (high.x - low.x, 0.5 * (low + high));
    if wide > WIDEST {
        return Err(format!(
            "the map is {wide:.1} degrees wide, more than the {WIDEST} that a UTM zone can hold; {ask}"
        ));
    }
    if !(low.y >= LATITUDES[0] && high.y <= LATITUDES[1]) {
        return Err(format!("the map goes from latitude {} to {}, where there is no UTM; {ask}", low.y, high.y));
    }
    Ok(zone_at(DVec2 { x, y }))
}

/// Code of the UTM zone of a longitude and latitude.
fn zone_at(DVec2 { x, y }: DVec2) -> u32 {
    let number = 1 + ((x + 180.0).rem_euclid(360.0) / ZONE).floor() as u32;
    UTM[usize::from(y < 0.0)] + number.min(60)
}

/// Note on lines in Web Mercator, whose lengths are `cosh(y / R)` times those on the ground.
pub fn stretched(lines: &[ContourLine], crs: &Crs) -> Option<String> {
    let (code, radius) = WEB_MERCATOR;
    let [low, high] = bounds(lines.iter().flat_map(|line| &line.points));
    let middle = 0.5 * (low + high) / radius;
    let factor = libm::cosh(middle.y);
    let at = DVec2::new(middle.x, libm::atan(libm::sinh(middle.y))).map(f64::to_degrees);
    (*crs == Crs::Epsg(code) && factor > 1.0 + STRETCHED).then(|| {
        format!(
            "lengths in EPSG:{code}, Web Mercator, are {factor:.3} times those on the ground at latitude {:.1}, heights are not: slopes, areas and \
             volumes are off by that; --crs-out EPSG:{} makes them right",
            at.y,
            zone_at(at)
        )
    })
}

/// Metres of the unit that x and y have in a system, where that is known and they are lengths.
pub fn metres(crs: &Crs) -> Option<f64> {
    match crs {
        Crs::Epsg(code) if !crs.is_geographic() => system(*code).ok().filter(|s| !s.is_latlong()).map(|s| s.to_meter()),
        _ => crs.metres().filter(|_| !crs.is_geographic()),
    }
}

fn system(code: u32) -> Check<Proj> {
    let known =
        u16::try_from(code).map_err(|e| e.to_string()).and_then(|c| Proj::from_epsg_code(c).map_err(|e| e.to_string()));
    known.map_err(|e| format!("EPSG:{code} is not known to this program ({e}); reproject the file, or name another"))
}

/// Name in a text.
fn name(wkt: &str) -> &str {
    wkt.split('"').nth(1).unwrap_or(wkt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_systems_are_those_of_the_registry() {
        for (code, metres) in [
            (32616, Some(1.0)),
            (2274, Some(1200.0 / 3937.0)),
            (2225, Some(1200.0 / 3937.0)),
            (4326, None),
            (4269, None),
        ] {
            let found = super::metres(&Crs::Epsg(code));
            let alike = found.zip(metres).is_none_or(|(a, b)| (a - b).abs() < 1e-12);
            assert!(found.is_some() == metres.is_some() && alike, "EPSG:{code}: {found:?}");
        }
        let feet = "PROJCS[\"a\",GEOGCS[\"b\",UNIT[\"Degree\",0.0174]],UNIT[\"Foot\",0.3048]]";
        assert_eq!(super::metres(&Crs::of_wkt(feet)), Some(0.3048));
    }

    /// Places as PROJ 9 has them (pyproj).
    #[test]
    fn places_are_those_of_proj() {
        for (from, to, at, wanted) in [
            (4326, 32616, [-84.2, 36.3], [751428.270448566, 4020862.416234424]),
            (4326, 3857, [-84.2, 36.3], [-9373101.124793636, 4341979.815756792]),
            (2056, 32632, [2600000.0, 1200000.0], [381188.8151136484, 5200911.2992899725]),
        ] {
            let line = ContourLine { feature: "a".into(), z: 0.0, points: vec![at.into()], closed: false };
            let mut lines = [line];
            let (crs, _) = project(&mut lines, Crs::Epsg(from), Some(&format!("EPSG:{to}"))).expect("both are known");
            let off = lines[0].points[0].distance(wanted.into());
            assert!(crs == Crs::Epsg(to) && off < 1e-3, "EPSG:{from} to EPSG:{to}: {off} m");
        }
    }

    #[test]
    fn the_zone_is_that_of_the_middle() {
        for (x, y, wanted) in [
            (-180.0, 1.0, 32601),
            // A hair further west the remainder of 360 is 360.
            (-180.00000000000003, 1.0, 32660),
            (179.9, -1.0, 32760),
            (3.0, 1.0, 32631),
            (363.0, 1.0, 32631),
        ] {
            let line = ContourLine { feature: "a".into(), z: 0.0, points: vec![DVec2::new(x, y)], closed: false };
            assert_eq!(zone(&[line]), Ok(wanted), "({x}, {y})");
        }
    }
}
