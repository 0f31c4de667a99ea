//! Description of a file's content: the JSON of glTF.

use std::collections::BTreeMap;
use std::io;

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Target, View};
use gltf_json::material::{PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::validation::{Checked, USize64};
use gltf_json::{Accessor, Asset, Buffer, Index, Material, Mesh, Node, Root, Scene, Value};
use serde_json::json;
use serde_json::value::{RawValue, to_raw_value};

use super::colour;
use super::frame::SceneFrame;
use super::part::{MeshPart, VERTEX_BYTES};

/// The description of meshes whose data follow each other. A body without a surface has no mesh: glTF knows no empty ones.
pub(super) fn described(parts: &[MeshPart]) -> io::Result<Root> {
    let mut root = Root {
        asset: Asset { generator: Some(concat!("interslice ", env!("CARGO_PKG_VERSION")).into()), ..Asset::default() },
        ..Root::default()
    };
    let bytes: u64 = parts.iter().map(MeshPart::bytes).sum();
    let mut nodes = Vec::new();
    if bytes > 0 {
        let byte_length = USize64(bytes);
        let buffer = root.push(Buffer { byte_length, name: None, uri: None, extensions: None, extras: None });
        let mut offset = 0;
        for part in parts.iter().filter(|part| part.counts[1] > 0) {
            let name = part.about.appearance.name.clone();
            let mesh = mesh(&mut root, part, buffer, offset)?;
            // An origin is f32 already.
            let translation = part.is_moved().then(|| part.about.origin.as_vec3().to_array());
            nodes.push(root.push(Node { mesh: Some(mesh), name, translation, ..Node::default() }));
            offset += part.bytes();
        }
    }
    if let Some(first) = parts.first()
        && let Some(above) = first.about.frame.node(&first.about.unit)?
    {
        let children = Some(std::mem::take(&mut nodes));
        nodes.push(root.push(Node { children, ..above }));
    }
    let extras = parts.first().map(|part| about(part, false)).transpose()?;
    let scene = Scene { extensions: None, extras, name: None, nodes };
    root.scene = Some(root.push(scene));
    Ok(root)
}

/// The unit and the directions of the axes; of a mesh its number, and its origin where that is not the world's.
fn about(part: &MeshPart, is_mesh: bool) -> io::Result<Box<RawValue>> {
    let frame = if is_mesh { SceneFrame::default() } else { part.about.frame };
    let [unit, space] = frame.words(&part.about.unit);
    let mut about = json!({"unit": unit, "space": space});
    if let Some(number) = part.about.appearance.number.filter(|_| is_mesh) {
        about["number"] = number.into();
    }
    if is_mesh && part.is_moved() {
        about["origin"] = json!(part.about.origin);
    }
    Ok(to_raw_value(&about)?)
}

/// A mesh whose data begin at `offset`.
fn mesh(root: &mut Root, part: &MeshPart, buffer: Index<Buffer>, offset: u64) -> io::Result<Index<Mesh>> {
    let ([vertices, triangles], [positions, normals, _]) = (part.counts, part.lengths());
    let range = [part.low, part.high].map(|v| Some(json!(v)));
    let corners = vectors(root, buffer, offset, vertices, range);
    let turned = vectors(root, buffer, offset + positions, vertices, [None, None]);
    let faces = indices(root, buffer, offset + positions + normals, 3 * triangles);
    let attributes: BTreeMap<Checked<Semantic>, Index<Accessor>> =
        [(Checked::Valid(Semantic::Positions), corners), (Checked::Valid(Semantic::Normals), turned)].into();
    let name = part.about.appearance.name.clone();
    let material = root.push(Material {
        name: name.clone(),
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor(colour::base(&part.about.appearance)),
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
        mode: Checked::Valid(Mode::Triangles),
        targets: None,
    };
    let extras = Some(about(part, true)?);
    Ok(root.push(Mesh { extensions: None, extras, name, primitives: vec![primitive], weights: None }))
}

/// `count` vectors of three f32, with the least and the largest of them.
fn vectors(
    root: &mut Root,
    buffer: Index<Buffer>,
    offset: u64,
    count: u64,
    [min, max]: [Option<Value>; 2],
) -> Index<Accessor> {
    let view = view(root, buffer, offset, count * VERTEX_BYTES, Target::ArrayBuffer);
    root.push(Accessor { min, max, ..accessor(view, count, ComponentType::F32, Type::Vec3) })
}

/// `count` u32.
fn indices(root: &mut Root, buffer: Index<Buffer>, offset: u64, count: u64) -> Index<Accessor> {
    let view = view(root, buffer, offset, 4 * count, Target::ElementArrayBuffer);
    root.push(accessor(view, count, ComponentType::U32, Type::Scalar))
}

fn view(root: &mut Root, buffer: Index<Buffer>, offset: u64, length: u64, target: Target) -> Index<View> {
    root.push(View {
        buffer,
        byte_length: USize64(length),
        byte_offset: Some(USize64(offset)),
        byte_stride: None,
        name: None,
        target: Some(Checked::Valid(target)),
        extensions: None,
        extras: None,
    })
}

fn accessor(view: Index<View>, count: u64, component: ComponentType, type_: Type) -> Accessor {
    Accessor {
        buffer_view: Some(view),
        byte_offset: None,
        count: USize64(count),
        component_type: Checked::Valid(GenericComponentType(component)),
        type_: Checked::Valid(type_),
        min: None,
        max: None,
        name: None,
        normalized: false,
        sparse: None,
        extensions: None,
        extras: None,
    }
}
