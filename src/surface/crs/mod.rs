//! Coordinate systems as contour files name them. Of a compound system, of the plane and of heights, the plane's is the map's.

mod registry;

use serde::{Deserialize, Serialize};

/// Esri's names of systems in a .prj, without the authority's code: name before the zone, code of zone 1 north and south.
const ESRI_UTM: [(&str, u32, u32); 3] =
    [("WGS_1984_UTM_ZONE_", 32601, 32701), ("NAD_1983_UTM_ZONE_", 26901, 0), ("ETRS_1989_UTM_ZONE_", 25801, 0)];

/// What a file says of its coordinates.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapCrs {
    /// System of x and y.
    pub crs: Crs,
    /// Metres of the unit of heights, where a system of heights says it.
    pub height_metres: Option<f64>,
}

impl From<Crs> for MapCrs {
    fn from(crs: Crs) -> Self {
        MapCrs { crs, height_metres: None }
    }
}

impl MapCrs {
    /// What [`Crs::named`] takes; of a compound system also `urn:ogc:def:crs,crs:EPSG::32633,crs:EPSG::5773` and `EPSG:32633+5773`.
    pub fn named(name: &str) -> Option<Self> {
        let upper = name.trim().to_uppercase();
        let parts: Vec<&str> = match upper.contains(",CRS:") {
            true => upper.split(",CRS:").skip(1).collect(),
            false => upper.split('+').collect(),
        };
        let [plane, heights @ ..] = &parts[..] else { return None };
        let of_code = |code: u32| match registry::parts(code) {
            Some([plane, heights]) => {
                MapCrs { crs: Crs::Epsg(plane), height_metres: Some(registry::metres_of_heights(heights)) }
            }
            None => Crs::Epsg(code).into(),
        };
        let found = match *plane {
            "LOCAL" => Crs::Local.into(),
            name if name.ends_with(":CRS84") => Crs::Epsg(4326).into(),
            // Of codes GeoTIFF has 16 bits, of which 32767 means "of one's own".
            name => of_code(code_of(name, upper.contains("EPSG")).filter(|code| (1024..32767).contains(code))?),
        };
        let heights = match heights {
            [] => None,
            [heights] => Some(registry::metres_of_heights(code_of(heights, true)?)),
            _ => return None,
        };
        Some(MapCrs { height_metres: heights.or(found.height_metres), ..found })
    }

    /// What [`Crs::of_wkt`] takes, or the text of a compound system.
    pub fn of_wkt(wkt: &str) -> Self {
        let wkt = trimmed(wkt);
        let upper = wkt.to_uppercase();
        if !["COMPD_CS", "COMPOUNDCRS"].iter().any(|key| upper.starts_with(key)) {
            let found = Crs::of_wkt(wkt);
            let named = if let Crs::Epsg(code) = found { Self::named(&format!("EPSG:{code}")) } else { None };
            return named.unwrap_or(found.into());
        }
        let [_, plane, heights, ..] = children(wkt)[..] else { return Crs::Wkt(wkt.into()).into() };
        MapCrs { crs: Crs::of_wkt(plane), height_metres: metres(heights) }
    }
}

/// The number at the end of `EPSG:N`, of a URN or of an address.
fn code_of(name: &str, is_epsg: bool) -> Option<u32> {
    if is_epsg { name.rsplit([':', '/']).next()?.parse().ok() } else { None }
}

/// A text without what may lie around it.
fn trimmed(wkt: &str) -> &str {
    wkt.trim_matches(['\u{feff}', '\0', ' ', '\n', '\r', '\t'])
}

/// Whether a text begins as well-known text does, with a keyword and what it holds in brackets: `PROJCS["..`.
fn is_wkt(text: &str) -> bool {
    let holds = text.trim_start_matches(|c: char| c.is_ascii_alphanumeric() || c == '_').trim_start();
    text.starts_with(|c: char| c.is_ascii_alphabetic()) && holds.starts_with(['[', '('])
}

/// What stands between the outermost brackets of a text, apart by commas.
fn children(wkt: &str) -> Vec<&str> {
    let (mut depth, mut quoted, mut first) = (0, false, 0);
    let mut found = Vec::new();
    for (at, c) in wkt.char_indices() {
        match c {
            '"' => quoted = !quoted,
            _ if quoted => {}
            '[' | '(' => {
                depth += 1;
                first = if depth == 1 { at + 1 } else { first };
            }
            ',' | ']' | ')' if depth == 1 => {
                found.push(wkt[first..at].trim());
                first = at + 1;
                depth -= i32::from(c != ',');
            }
            ']' | ')' => depth -= 1,
            _ => {}
        }
    }
    found
}

/// Metres of the last unit in a text, which is that of the system's own coordinates.
fn metres(wkt: &str) -> Option<f64> {
    let upper = wkt.to_ascii_uppercase();
    let at = upper.rfind("LENGTHUNIT[").or_else(|| upper.rfind("UNIT["))?;
    let metres: f64 = wkt.get(at..)?.split([',', ']']).nth(1)?.trim().parse().ok()?;
    // An unknown unit has 0.
    (metres.is_finite() && metres > 0.0).then_some(metres)
}

/// A coordinate system of the plane.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Crs {
    /// The file does not say.
    #[default]
    Unknown,
    /// Plane coordinates of one's own, in no known system.
    Local,
    /// Number in the EPSG registry.
    Epsg(u32),
    /// Well-known text whose EPSG code is not known.
    Wkt(String),
}

impl Crs {
    /// `EPSG:32611`, `urn:ogc:def:crs:EPSG::32611`, `urn:ogc:def:crs:OGC:1.3:CRS84`, `local`; of a compound system that of the plane.
    pub fn named(name: &str) -> Option<Self> {
        MapCrs::named(name).map(|named| named.crs)
    }

    /// Well-known text, as a .prj has it; its code where it names one. What is no such text says nothing.
    pub fn of_wkt(wkt: &str) -> Self {
        let wkt = trimmed(wkt);
        let upper = wkt.to_uppercase();
        let local = ["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"].iter().any(|key| upper.starts_with(key));
        // What GDAL writes where it knows nothing: "Undefined SRS", of an unknown unit.
        let unknown = local
            && ["UNDEFINED", "UNKNOWN"].iter().any(|word| upper.split('"').nth(1).is_some_and(|n| n.contains(word)));
        match !is_wkt(wkt) || unknown {
            true => Crs::Unknown,
            false if local => Crs::Local,
            false => epsg_of(wkt).map_or_else(|| Crs::Wkt(wkt.into()), Crs::Epsg),
        }
    }

    /// Whether its coordinates are known to be degrees.
    pub fn is_geographic(&self) -> bool {
        match self {
            Crs::Epsg(code) => registry::is_geographic(*code),
            Crs::Wkt(wkt) => ["GEOGCS", "GEOGCRS", "GEODCRS"].iter().any(|k| wkt.to_uppercase().starts_with(k)),
            Crs::Unknown | Crs::Local => false,
        }
    }

    /// Metres of its length unit, where the text says.
    pub fn metres(&self) -> Option<f64> {
        if let Crs::Wkt(wkt) = self { metres(wkt) } else { None }
    }
}

/// The code of the outermost authority, or of a UTM zone or Web Mercator by Esri's name.
fn epsg_of(wkt: &str) -> Option<u32> {
    let squeezed: String = wkt.to_uppercase().chars().filter(|c| !c.is_whitespace() && *c != '"').collect();
    for key in ["AUTHORITY[EPSG,", "ID[EPSG,"] {
        // That of the whole is the last, at the end.
        if let Some(at) = squeezed.rfind(key) {
            let rest = &squeezed[at + key.len()..];
            let code = rest.split(']').next()?;
            if rest[code.len()..].chars().all(|c| c == ']') {
                return code.parse().ok();
            }
        }
    }
    let name = squeezed.strip_prefix("PROJCS[").or_else(|| squeezed.strip_prefix("PROJCRS["))?.split(',').next()?;
    if name == "WGS_1984_WEB_MERCATOR_AUXILIARY_SPHERE" {
        return Some(3857);
    }
    let (zone, north, south) = ESRI_UTM.iter().find_map(|(p, n, s)| Some((name.strip_prefix(p)?, *n, *s)))?;
    let number: u32 = zone.trim_end_matches(['N', 'S']).parse().ok().filter(|n| (1..=60).contains(n))?;
    match zone.ends_with('S') {
        false => Some(north + number - 1),
        true => (south > 0).then_some(south + number - 1),
    }
}

#[cfg(test)]
mod tests {
    use super::{Crs, MapCrs};

    #[test]
    fn of_a_compound_system_the_map_has_the_planes() {
        let us = 1200.0 / 3937.0;
        for (name, code, heights) in [
            ("EPSG:9707", 4326, Some(1.0)),
            ("EPSG:5973", 25833, Some(1.0)),
            ("EPSG:8360", 4258, Some(1.0)),
            ("urn:ogc:def:crs:EPSG::6349", 6318, Some(1.0)),
            ("urn:ogc:def:crs,crs:EPSG::32633,crs:EPSG::5773", 32633, Some(1.0)),
            ("EPSG:26913+6360", 26913, Some(us)),
            ("http://www.opengis.net/def/crs/EPSG/0/5698", 2154, Some(1.0)),
            ("EPSG:32633", 32633, None),
        ] {
            let wanted = MapCrs { crs: Crs::Epsg(code), height_metres: heights };
            assert_eq!(MapCrs::named(name), Some(wanted.clone()), "{name}");
            assert_eq!(Crs::named(name), Some(wanted.crs), "{name}");
        }
        for wrong in
            ["EPSG:32633+feet", "EPSG:32633+5773+5773", "urn:ogc:def:crs,crs:EPSG::zone,crs:EPSG::5773", "+", ""]
        {
            assert_eq!(MapCrs::named(wrong), None, "{wrong}");
        }
        let plane = r#"PROJCS["WGS 84 / UTM zone 33N",GEOGCS["WGS 84",UNIT["degree",0.0174]],UNIT["metre",1],AUTHORITY["EPSG","32633"]]"#;
        let of_heights = r#"VERT_CS["a ], name",VERT_DATUM["b",2005],UNIT["US survey foot",0.3048006096],AXIS["Up",UP],AUTHORITY["EPSG","6360"]]"#;
        let whole = |own: &str| format!(r#"COMPD_CS["both, of [them",{plane},{of_heights}{own}]"#);
        for own in ["", r#",AUTHORITY["EPSG","9999"]"#] {
            let found = MapCrs::of_wkt(&whole(own));
            assert_eq!(found, MapCrs { crs: Crs::Epsg(32633), height_metres: Some(0.3048006096) });
        }
        let modern = r#"COMPOUNDCRS["x",GEOGCRS["mine",ANGLEUNIT["degree",0.0174]],VERTCRS["y",CS[vertical,1],LENGTHUNIT["foot",0.3048]]]"#;
        let found = MapCrs::of_wkt(modern);
        assert!(found.crs.is_geographic() && found.height_metres == Some(0.3048), "{found:?}");
        // Cut off, and with brackets that do not belong together.
        for damaged in ["COMPD_CS", "COMPD_CS[", "COMPD_CS[\"a", "COMPD_CS]]]]", "COMPD_CS[\"a\",],b)"] {
            let found = MapCrs::of_wkt(damaged);
            assert!(found.height_metres.is_none() && !matches!(found.crs, Crs::Epsg(_)), "{damaged}: {found:?}");
        }
    }

    #[test]
    fn what_is_undefined_is_not_known() {
        let undefined =
            r#"LOCAL_CS["Undefined SRS",LOCAL_DATUM["unknown",32767],UNIT["unknown",0],AXIS["Easting",EAST]]"#;
        for nothing in [undefined, "undefined", "", "garbage", "GEOGCS", "[]", "<html>[x]", "+proj=utm +zone=33"] {
            assert_eq!(Crs::of_wkt(nothing), Crs::Unknown, "{nothing}");
        }
        assert_eq!(Crs::of_wkt("PROJCS (\"a\")"), Crs::Wkt("PROJCS (\"a\")".into()));
        assert_eq!(Crs::of_wkt(r#"LOCAL_CS["site",UNIT["metre",1]]"#), Crs::Local);
        assert_eq!(Crs::of_wkt(r#"PROJCS["a",UNIT["unknown",0]]"#).metres(), None);
        // A letter whose capitals are longer.
        let name = "\u{149}".repeat(60);
        assert_eq!(Crs::of_wkt(&format!(r#"PROJCS["{name}",UNIT["foot",0.3048]]"#)).metres(), Some(0.3048));
    }

    #[test]
    fn codes_are_found_in_names_and_texts() {
        for name in ["EPSG:32611", "urn:ogc:def:crs:EPSG::32611", "http://www.opengis.net/def/crs/EPSG/0/32611"] {
            assert_eq!(Crs::named(name), Some(Crs::Epsg(32611)), "{name}");
        }
        assert_eq!(Crs::named("EPSG:zone"), None);
        let utm = r#"PROJCS["WGS_1984_UTM_Zone_11N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]],UNIT["Meter",1.0]]"#;
        assert_eq!(Crs::of_wkt(utm), Crs::Epsg(32611));
        let inner = r#"PROJCS["Mine",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],UNIT["foot",0.3048]]"#;
        assert_eq!(Crs::of_wkt(inner), Crs::Wkt(inner.into()));
        assert_eq!(Crs::of_wkt(inner).metres(), Some(0.3048));
        let outer = r#"PROJCS["Mine",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],AUTHORITY["EPSG","2056"]]"#;
        assert_eq!(Crs::of_wkt(outer), Crs::Epsg(2056));
        assert!(Crs::of_wkt(r#"GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984"]]"#).is_geographic());
    }
}
