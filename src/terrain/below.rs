//! What a height map has below the lowest contour.

use super::join::Elevation;
use crate::error::{Error, Result};
use crate::polygons::distance::near_distance;
use crate::polygons::edges::Edge;
use crate::polygons::grid::DrawingGrid;
use crate::reference::exact::exact_distance;
use crate::stack::SliceContent;
use crate::stack::options::Below;
use crate::surface::map::{Floor, Map};

/// Distances from a contour, px, between which those from the drawn lines, exact but dear, go over into those from pixel to pixel, which are up to
/// half a pixel off.
const BLEND: [f64; 2] = [12.0, 24.0];

/// A level and what is at least so high.
pub struct Region<'a> {
    pub level: &'a Elevation,
    pub content: &'a SliceContent,
}

/// What lies below the lowest contour, pixel by pixel of the map, from the lowest two regions.
///
/// To extrapolate: `h = z0 - (z1 - z0) d0 / d1`, where d0 and d1 are the distances to the regions of the lowest two levels z0 and z1. At the lowest
/// contour that has the slope of straight lines between the two, and far from it comes near to `z0 - (z1 - z0)`, where the next contour would be: as
/// it was not drawn, the terrain does not get there.
///
/// # Errors
/// [`Error::Setting`] for a map of one level, which has no slope.
pub fn floor(below: Option<Below>, lowest: &[Region<'_>], grid: &DrawingGrid, map: &Map) -> Result<Floor> {
    match (below, lowest) {
        (None | Some(Below::Nodata), _) | (_, []) => Ok(Floor::Nodata),
        (Some(Below::Constant), [lowest, ..]) => Ok(Floor::Constant(lowest.level.z)),
        (Some(Below::Extrapolate), [lowest, next, ..]) => {
            let [from, to] = [lowest, next].map(|region| distances(region, grid));
            let (z0, gap) = (lowest.level.z, next.level.z - lowest.level.z);
            let rows = (map.first[1]..map.first[1] + map.dims[1]).map(|j| j * grid.dims[0] + map.first[0]);
            let heights = rows.flat_map(|row| row..row + map.dims[0]).map(|node| {
                let [d0, d1] = [&from, &to].map(|distances| distances[node]);
                // Where lines of the two levels touch, each may lie a little on the wrong side of the other.
                let share = if d0 > 0.0 && d1 > 0.0 { (d0 / d1).min(1.0) } else { 0.0 };
                z0 - gap * share
            });
            Ok(Floor::Heights(heights.collect()))
        }
        (Some(Below::Extrapolate), [only]) => Err(Error::Setting {
            name: "below".into(),
            message: format!("extrapolate needs two levels, between which is a slope; there is only {}", only.level.z),
        }),
    }
}

/// Signed distance of every pixel to a level's lines, negative inside.
fn distances(region: &Region<'_>, grid: &DrawingGrid) -> Vec<f64> {
    let px = grid.spacing.max_element();
    let mut distances = exact_distance(&region.content.sides(), grid.dims, grid.spacing.to_array()).data;
    let Elevation { rings, open, .. } = region.level;
    let back = rings.iter().filter_map(|ring| Some([*ring.last()?, *ring.first()?]));
    let edges: Vec<Edge> =
        rings.iter().chain(open).flat_map(|line| line.windows(2)).map(|w| [w[0], w[1]]).chain(back).collect();
    let near = near_distance(&edges, grid, BLEND[1] * px);
    for (d, near) in distances.iter_mut().zip(near) {
        let near = f64::from(near);
        let share = ((near / px - BLEND[0]) / (BLEND[1] - BLEND[0])).clamp(0.0, 1.0);
        if share < 1.0 {
            *d = near.copysign(*d) + share * (*d - near.copysign(*d));
        }
    }
    distances
}
