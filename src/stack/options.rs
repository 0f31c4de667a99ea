//! Options of reading: what a user may choose of an input.

use std::convert::Infallible;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::stack::axis::Axis;
use crate::stack::cut::Cut;

/// Options of reading an input.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[command(next_help_heading = "Input")]
pub struct ReadOptions {
    /// Grey slices and volumes: the contour runs where the value crosses this level, inside is above [default: the middle of the slices' range;
    /// a volume without a level holds labels]
    #[arg(long, value_name = "VALUE")]
    pub level: Option<f64>,

    /// Grey slices and volumes, and images of two values: inside is what lies below the level, or is black
    #[arg(long)]
    pub invert: bool,

    /// Label volumes, and folders of label images: reconstruct this label only, by number or by the name that the file gives it
    /// [default: all that is not zero, the larger of two values]
    #[arg(long, value_name = "N|NAME", allow_hyphen_values = true, conflicts_with = "level")]
    pub label: Option<LabelName>,

    /// RTSTRUCT: the ROI, by name or number (`number=3` where another one has the name 3); repeatable, several are merged into one body
    #[arg(long, value_name = "NAME|NUMBER")]
    #[serde(deserialize_with = "one_or_many")]
    pub roi: Vec<RoiName>,

    /// DICOM folders: the RTSTRUCT, by the UID or number of its series or by its own UID, where the folder has several
    #[arg(long, value_name = "UID|NUMBER")]
    #[serde(deserialize_with = "name_or_number")]
    pub series: Option<String>,

    /// Polygons, RTSTRUCT and contour maps: side of the pixels the contours are laid on, in the input's unit [default: the input's
    /// `spacing_xy`; half the distance of neighbouring points, finer for what is thin or drawn with few points, coarser where points say nothing of the
    /// shape; of a map the points' median distance, within an eighth to a quarter
    /// of that of its lines]
    #[arg(long, value_name = "LENGTH")]
    pub pixel: Option<f64>,

    /// GeoPackage: the layer that has the contours [default: the only one of lines or polygons]
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,

    /// Contour maps: the attribute that is the elevation [default: the one named elev..., height, contour, ..., else the points' z, else the one named level, z, ...]
    #[arg(long, value_name = "FIELD")]
    pub elevation: Option<String>,

    /// Contour maps: the unit of the elevation, which becomes that of x and y [default: that of x and y]
    #[arg(long, value_enum, value_name = "UNIT")]
    pub z_unit: Option<ZUnit>,

    /// Contour maps: where the map ends: in the box around all lines; in their convex hull, where a line may end anywhere inside the box; or in a box
    /// in the coordinates of the outputs, beyond which lines are cut [default: the box, and the hull for ends within 1 % of the map of it]
    #[arg(long, value_name = "box|hull|X0,Y0,X1,Y1", allow_hyphen_values = true)]
    pub border: Option<MapBorder>,

    /// Contour maps: what a height map has below the lowest contour: no data; the height of that contour; or the slope between the lowest two
    /// contours, going on ever more gently and never as far as the next contour would lie [default: nodata]
    #[arg(long, value_enum, value_name = "WHAT")]
    pub below: Option<Below>,

    /// Contour maps: coordinate system of x and y, EPSG:N, or local where they are lengths in none [default: what the file names]
    #[arg(long, value_name = "EPSG:N|local")]
    pub crs: Option<String>,

    /// Contour maps: reproject x and y to this coordinate system, EPSG:N [default: degrees to the UTM zone of the map's middle, others not at all]
    #[arg(long, value_name = "EPSG:N")]
    pub crs_out: Option<String>,

    /// Volumes, label images and RTSTRUCT: use every K-th slice only [default: the slices that have the label, the planes that are drawn]
    #[arg(long, value_name = "K", conflicts_with = "slices")]
    pub keep: Option<usize>,

    /// Volumes and RTSTRUCT: use these slices (drawn planes) only, numbered from 0
    #[arg(long, value_name = "I,J,..", value_delimiter = ',')]
    pub slices: Option<Vec<usize>>,

    /// Many labels: a slice that is painted with any of them is complete, labels that are not on it end there [default: each label has the
    /// slices on which it is painted; chosen slices are complete, and so are those of a label that is painted slice by slice]
    #[arg(long)]
    pub complete_slices: bool,

    /// Label volumes: the axis along which slices lie [default: that along which painted slices stand alone, else that of the coarsest
    /// spacing, else z]
    #[arg(long, value_name = "AXIS", default_value = "auto", hide_default_value = true)]
    pub axis: Axis,

    /// Folders of images without stack.json, and label volumes whose file does not tell, as a .npy never does: sides of a voxel along x, y, z, mm [default: 1 px]
    #[arg(long, value_name = "DX,DY,DZ", value_delimiter = ',')]
    pub spacing: Option<Vec<f64>>,
}

impl ReadOptions {
    /// Where grey values are cut.
    pub fn cut(&self) -> Option<Cut> {
        self.level.map(|level| Cut { level, below: self.invert })
    }
}

/// Where a contour map ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "must be \"box\", \"hull\" or four numbers [X0, Y0, X1, Y1]")]
pub enum MapBorder {
    /// Around all lines.
    Around(Around),
    /// X0, Y0, X1, Y1.
    Given(Vec<f64>),
}

/// What lies around all lines of a contour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Around {
    /// The box along the axes: lines end there and nowhere else.
    Box,
    /// The convex hull: a line that ends inside goes on to the box.
    Hull,
}

impl FromStr for MapBorder {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.trim() {
            "box" => Ok(MapBorder::Around(Around::Box)),
            "hull" => Ok(MapBorder::Around(Around::Hull)),
            numbers => {
                let values: Result<Vec<f64>, _> = numbers.split(',').map(|v| v.trim().parse()).collect();
                values.map(MapBorder::Given).map_err(|_| "expected box, hull or four numbers X0,Y0,X1,Y1".into())
            }
        }
    }
}

/// What a height map has below the lowest contour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Below {
    /// Nothing (NaN).
    Nodata,
    /// The height of the lowest contour.
    Constant,
    /// The slope of the terrain above it, going on ever more gently.
    Extrapolate,
}

/// Unit of elevations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ZUnit {
    /// Metres.
    M,
    /// Feet of 0.3048 m.
    Ft,
    /// US survey feet, 1200 / 3937 m.
    UsFt,
}

impl ZUnit {
    /// Metres of it.
    pub fn metres(self) -> f64 {
        match self {
            ZUnit::M => 1.0,
            ZUnit::Ft => 0.3048,
            ZUnit::UsFt => 1200.0 / 3937.0,
        }
    }
}

/// Why 0 is refused as a label.
pub(crate) const BACKGROUND: &str = "0 is the background and no label";

/// A label as the user names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum LabelName {
    /// By its value.
    Number(i64),
    /// By its name in the file.
    Name(String),
}

impl From<i64> for LabelName {
    fn from(number: i64) -> Self {
        LabelName::Number(number)
    }
}

impl From<&str> for LabelName {
    fn from(text: &str) -> Self {
        let text = text.trim();
        text.parse().map_or_else(|_| LabelName::Name(text.into()), LabelName::Number)
    }
}

impl FromStr for LabelName {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(text.into())
    }
}

/// A ROI as the user names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RoiName {
    /// By its number, whatever others are called.
    Number(i64),
    /// By its name, or by its number where none has it as its name.
    Text(String),
}

/// What makes a number of a text, whatever ROIs are called.
const BY_NUMBER: &str = "number=";

impl From<i64> for RoiName {
    fn from(number: i64) -> Self {
        RoiName::Number(number)
    }
}

impl From<&str> for RoiName {
    fn from(text: &str) -> Self {
        let number = text.trim().strip_prefix(BY_NUMBER).and_then(|n| n.parse().ok());
        number.map_or_else(|| RoiName::Text(text.into()), RoiName::Number)
    }
}

impl FromStr for RoiName {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(text.into())
    }
}

/// One or several, as a settings file or a manifest may give them: numbers, or text as it is typed.
fn one_or_many<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<RoiName>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Names {
        One(Name),
        Many(Vec<Name>),
    }
    let roi = |name| match name {
        Name::Text(text) => RoiName::from(text.as_str()),
        Name::Number(number) => RoiName::Number(number),
    };
    Ok(match Names::deserialize(deserializer)? {
        Names::One(name) => vec![roi(name)],
        Names::Many(names) => names.into_iter().map(roi).collect(),
    })
}

/// A name, or a number that stands for one.
#[derive(Deserialize)]
#[serde(untagged)]
enum Name {
    Text(String),
    Number(i64),
}

impl Name {
    fn text(self) -> String {
        match self {
            Name::Text(text) => text,
            Name::Number(number) => number.to_string(),
        }
    }
}

/// Reads a name, or a number that stands for one.
///
/// # Errors
/// The errors of `deserializer` for anything else.
pub fn name_or_number<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Ok(Option::<Name>::deserialize(deserializer)?.map(Name::text))
}
