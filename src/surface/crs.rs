//! Coordinate systems as contour files name them.

use serde::{Deserialize, Serialize};

/// EPSG codes of the geographic systems (degrees) that files mostly have. Others are told by their WKT, or by coordinates that are no more
/// than 180 and 90.
const GEOGRAPHIC: [u32; 24] = [
    4121, 4148, 4167, 4171, 4230, 4258, 4267, 4269, 4277, 4283, 4312, 4314, 4322, 4326, 4490, 4612, 4617, 4619, 4674,
    4937, 4979, 6318, 6668, 7844,
];
/// Esri's names of systems in a .prj, without the authority's code: name before the zone, code of zone 1 north and south.
const ESRI_UTM: [(&str, u32, u32); 3] =
    [("WGS_1984_UTM_ZONE_", 32601, 32701), ("NAD_1983_UTM_ZONE_", 26901, 0), ("ETRS_1989_UTM_ZONE_", 25801, 0)];

/// A coordinate system.
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
    /// `EPSG:32611`, `urn:ogc:def:crs:EPSG::32611`, `urn:ogc:def:crs:OGC:1.3:CRS84`, `local`.
    pub fn named(name: &str) -> Option<Self> {
        let upper = name.trim().to_uppercase();
        if upper == "LOCAL" {
            return Some(Crs::Local);
        }
        if upper.ends_with(":CRS84") {
            return Some(Crs::Epsg(4326));
        }
        if !upper.contains("EPSG") {
            return None;
        }
        let code = upper.rsplit([':', '/']).next()?.parse().ok()?;
        // GeoTIFF has 16 bits for it, of which 32767 means "of one's own".
        (1024..32767).contains(&code).then_some(Crs::Epsg(code))
    }

    /// Well-known text, as a .prj has it; its code where it names one.
    pub fn of_wkt(wkt: &str) -> Self {
        let wkt = wkt.trim_matches(['\u{feff}', '\0', ' ', '\n', '\r', '\t']);
        if wkt.is_empty() {
            return Crs::Unknown;
        }
        epsg_of(wkt).map_or_else(|| Crs::Wkt(wkt.into()), Crs::Epsg)
    }

    /// Whether its coordinates are known to be degrees.
    pub fn is_geographic(&self) -> bool {
        match self {
            Crs::Epsg(code) => GEOGRAPHIC.contains(code),
            Crs::Wkt(wkt) => ["GEOGCS", "GEOGCRS", "GEODCRS"].iter().any(|k| wkt.to_uppercase().starts_with(k)),
            Crs::Unknown | Crs::Local => false,
        }
    }

    /// Metres of its length unit, where the text says.
    pub fn metres(&self) -> Option<f64> {
        let Crs::Wkt(wkt) = self else { return None };
        let upper = wkt.to_uppercase();
        // The last unit is that of the projected coordinates.
        let at = upper.rfind("LENGTHUNIT[").or_else(|| upper.rfind("UNIT["))?;
        wkt[at..].split([',', ']']).nth(1)?.trim().parse().ok()
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
    use super::Crs;

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
