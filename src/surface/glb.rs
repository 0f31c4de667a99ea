//! Meshes as binary glTF 2.0 (`.glb`): one named mesh with f32 positions and normals, u32 triangles and a base colour.
//!
//! Positions are those of all other outputs: world coordinates (LPS) in the stack's unit, neither scaled to glTF's metres nor turned to its
//! upright y, so that files of one case fit each other. The mesh's `extras` say so: `unit` and `space`.

use std::collections::BTreeMap;
use std::io::{self, Write};

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Target, View};
use gltf_json::material::{PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Primitive, Semantic};
use gltf_json::validation::{Checked, USize64};
use gltf_json::{Accessor, Asset, Buffer, Index, Material, Mesh, Node, Root, Scene, Value};
use serde_json::json;
use serde_json::value::to_raw_value;

use super::mesh::MeshSource;

/// Warm grey, linear.
const BODY: [f32; 4] = [0.71, 0.60, 0.45, 1.0];
const VERTEX_BYTES: u64 = 12;

/// What a mesh is called, and its unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// Name of the mesh.
    pub name: String,
    /// Length unit.
    pub unit: String,
}

/// Writes the mesh.
///
/// # Errors
/// Those of `out`; [`io::ErrorKind::InvalidInput`] beyond the 4 GiB that the format holds.
pub fn write_glb<W: Write>(out: &mut W, mesh: &mut dyn MeshSource, named: &Named) -> io::Result<()> {
    let [vertices, triangles] = mesh.counts();
    let (positions, indices) = (vertices * VERTEX_BYTES, triangles * 12);
    let bytes = 2 * positions + indices;
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    mesh.vertices(&mut |v| {
        for (a, x) in v.position.iter().enumerate() {
            (low[a], high[a]) = (low[a].min(*x as f32), high[a].max(*x as f32));
        }
        Ok(())
    })?;
    let mut json = serde_json::to_vec(&root(named, [vertices, triangles], [low, high])?)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    let whole = 12 + 8 + json.len() as u64 + if bytes > 0 { 8 + bytes } else { 0 };
    let length = |n: u64| {
        let fits = u32::try_from(n);
        fits.map_err(|_| {
            io::Error::new(io::ErrorKind::InvalidInput, "GLB holds at most 4 GiB: use .ply, or --simplify")
        })
    };
    out.write_all(b"glTF")?;
    for n in [2, length(whole)?, length(json.len() as u64)?] {
        out.write_all(&n.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(&json)?;
    if bytes > 0 {
        out.write_all(&length(bytes)?.to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        let mut three = |v: [f64; 3]| out.write_all(v.map(|x| (x as f32).to_le_bytes()).as_flattened());
        mesh.vertices(&mut |v| three(v.position))?;
        mesh.vertices(&mut |v| three(v.normal))?;
        mesh.triangles(&mut |t, _| out.write_all(t.map(|v| (v as u32).to_le_bytes()).as_flattened()))?;
    }
    out.flush()
}

/// The description. A body without a surface has no mesh: glTF knows no empty ones.
fn root(named: &Named, [vertices, triangles]: [u64; 2], [low, high]: [[f32; 3]; 2]) -> io::Result<Root> {
    let about = to_raw_value(&json!({"unit": named.unit, "space": "left-posterior-superior"}))?;
    let mut root = Root {
        asset: Asset { generator: Some(concat!("interslice ", env!("CARGO_PKG_VERSION")).into()), ..Asset::default() },
        ..Root::default()
    };
    let mut nodes = Vec::new();
    if triangles > 0 {
        let (positions, indices) = (vertices * VERTEX_BYTES, triangles * 12);
        let buffer = root.push(Buffer {
            byte_length: USize64(2 * positions + indices),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        let mut accessor = |offset: u64, length: u64, count: u64, triangles: bool, range: Option<[Value; 2]>| {
            let view = root.push(View {
                buffer,
                byte_length: USize64(length),
                byte_offset: Some(USize64(offset)),
                byte_stride: None,
                name: None,
                target: Some(Checked::Valid(if triangles { Target::ElementArrayBuffer } else { Target::ArrayBuffer })),
                extensions: None,
                extras: None,
            });
            let [min, max] = range.map_or([None, None], |r| r.map(Some));
            let (component, type_) =
                if triangles { (ComponentType::U32, Type::Scalar) } else { (ComponentType::F32, Type::Vec3) };
            root.push(Accessor {
                buffer_view: Some(view),
                byte_offset: None,
                count: USize64(count),
                component_type: Checked::Valid(GenericComponentType(component)),
                type_: Checked::Valid(type_),
                min,
                max,
                name: None,
                normalized: false,
                sparse: None,
                extensions: None,
                extras: None,
            })
        };
        let corners = accessor(0, positions, vertices, false, Some([low, high].map(|v| json!(v))));
        let normals = accessor(positions, positions, vertices, false, None);
        let faces = accessor(2 * positions, indices, 3 * triangles, true, None);
        let attributes: BTreeMap<Checked<Semantic>, Index<Accessor>> =
            [(Checked::Valid(Semantic::Positions), corners), (Checked::Valid(Semantic::Normals), normals)].into();
        let material = root.push(Material {
            name: Some(named.name.clone()),
            pbr_metallic_roughness: PbrMetallicRoughness {
                base_color_factor: PbrBaseColorFactor(BODY),
                metallic_factor: StrengthFactor(0.0),
                roughness_factor: StrengthFactor(0.7),
                ..PbrMetallicRoughness::default()
            },
            ..Material::default()
        });
        let primitive = Primitive {
            attributes,
            extensions: None,
            extras: None,
            indices: Some(faces),
            material: Some(material),
            mode: Checked::Valid(gltf_json::mesh::Mode::Triangles),
            targets: None,
        };
        let mesh = root.push(Mesh {
            extensions: None,
            extras: Some(about.clone()),
            name: Some(named.name.clone()),
            primitives: vec![primitive],
            weights: None,
        });
        nodes.push(root.push(Node { mesh: Some(mesh), name: Some(named.name.clone()), ..Node::default() }));
    }
    let scene = Scene { extensions: None, extras: Some(about), name: None, nodes };
    root.scene = Some(root.push(scene));
    Ok(root)
}
