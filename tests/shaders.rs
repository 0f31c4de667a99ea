//! The shaders as naga sees them: valid without any capability; variables, structs and constants as the host declares them.
#![cfg(feature = "gpu")]

use std::collections::BTreeSet;
use std::path::Path;

use interslice::gpu::kernels::{Access, Binding, Interface, interfaces};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, ScalarKind, StorageAccess, TypeInner};

struct Shader {
    declared: Interface,
    module: naga::Module,
    info: ModuleInfo,
}

fn shaders() -> Vec<Shader> {
    let shader = |declared: Interface| {
        let Interface { stem, text, .. } = declared;
        let module =
            naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{}", e.emit_to_string_with_path(text, stem)));
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{stem} is valid without capabilities: {e:?}"));
        Shader { declared, module, info }
    };
    interfaces().into_iter().map(shader).collect()
}

#[test]
fn every_file_of_a_shader_is_declared() {
    let declared: BTreeSet<String> = shaders().iter().map(|s| format!("{}.wgsl", s.declared.stem)).collect();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let files = folder.read_dir().expect("there are shaders").map(|f| f.expect("a file").file_name());
    let files: BTreeSet<String> =
        files.map(|name| name.to_string_lossy().into_owned()).filter(|name| name.ends_with(".wgsl")).collect();
    assert_eq!(declared, files);
}

/// A scalar's name, the same in Rust and WGSL.
fn scalar(scalar: naga::Scalar) -> &'static str {
    match scalar.kind {
        ScalarKind::Float => "f32",
        ScalarKind::Uint => "u32",
        ScalarKind::Sint => "i32",
        kind => panic!("{kind:?} is not shared"),
    }
}

/// A type as WGSL spells it. What is atomic on the device is a number on the host.
fn spelling(module: &naga::Module, ty: naga::Handle<naga::Type>) -> String {
    let ty = &module.types[ty];
    match &ty.inner {
        TypeInner::Scalar(s) | TypeInner::Atomic(s) => scalar(*s).into(),
        TypeInner::Vector { size, scalar: s } => format!("vec{}<{}>", *size as u8, scalar(*s)),
        TypeInner::Array { base, .. } => format!("array<{}>", spelling(module, *base)),
        TypeInner::Struct { .. } => ty.name.clone().expect("structs have names"),
        inner => panic!("{inner:?} is not shared"),
    }
}

/// What a type is made of in the end.
fn leaf(module: &naga::Module, ty: naga::Handle<naga::Type>) -> &'static str {
    match &module.types[ty].inner {
        TypeInner::Scalar(s) | TypeInner::Atomic(s) | TypeInner::Vector { scalar: s, .. } => scalar(*s),
        TypeInner::Array { base, .. } => leaf(module, *base),
        inner => panic!("{inner:?} in a struct"),
    }
}

fn access(space: AddressSpace) -> Access {
    match space {
        AddressSpace::Uniform => Access::Uniform,
        AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Access::Write,
        AddressSpace::Storage { .. } => Access::Read,
        space => panic!("{space:?} has no binding"),
    }
}

/// The host's buffers reach the variables that they are named after: for every entry point those that it uses, no more and no less, in the order
/// of their bindings, with their access and type.
#[test]
fn entry_points_use_what_the_host_declares() {
    for Shader { declared, module, info } in shaders() {
        let stem = declared.stem;
        let names: Vec<&str> = module.entry_points.iter().map(|e| e.name.as_str()).collect();
        let ours: Vec<&str> = declared.entries.iter().map(|e| e.name).collect();
        assert_eq!(BTreeSet::from_iter(&names), BTreeSet::from_iter(&ours), "entry points of {stem}");
        for entry in &declared.entries {
            let at = names.iter().position(|name| *name == entry.name).expect("an entry point");
            let used = info.get_entry_point(at);
            let mut theirs: Vec<_> = module
                .global_variables
                .iter()
                .filter(|(handle, _)| !used[*handle].is_empty())
                .filter_map(|(_, v)| {
                    let place = v.binding.as_ref()?;
                    assert_eq!(place.group, 0, "{stem}: group of {:?}", v.name);
                    Some((place.binding, v.name.clone()?, access(v.space), spelling(&module, v.ty)))
                })
                .collect();
            theirs.sort_unstable_by_key(|(binding, ..)| *binding);
            let theirs: Vec<_> = theirs.into_iter().map(|(_, name, access, ty)| (name, access, ty)).collect();
            let of = |b: &Binding| (b.name.to_string(), b.access, b.spelling.clone());
            let ours: Vec<_> = entry.bindings.iter().map(of).collect();
            assert_eq!(theirs, ours, "what `{}` of {stem}.wgsl uses, and what the host declares", entry.name);
        }
    }
}

#[test]
fn structs_are_laid_out_as_the_host_mirrors_them() {
    let mut compared = 0;
    for Shader { declared, module, .. } in shaders() {
        let stem = declared.stem;
        for ours in declared.entries.iter().flat_map(|e| &e.bindings).flat_map(|b| &b.structs) {
            let name = ours.name;
            let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
            let Some(naga::Type { inner: TypeInner::Struct { members, span }, .. }) = found.map(|(_, t)| t) else {
                panic!("{stem} has no struct {name}")
            };
            let mut members = members.clone();
            let open_ended = |m: &naga::StructMember| {
                matches!(module.types[m.ty].inner, TypeInner::Array { size: naga::ArraySize::Dynamic, .. })
            };
            let tail = members.pop_if(|m| open_ended(m));
            match &tail {
                Some(tail) => {
                    assert_eq!(tail.offset as usize, ours.size, "{stem}: where the list of {name} begins");
                    let item = ours.tail.as_ref().map(|item| format!("array<{item}>"));
                    assert_eq!(Some(spelling(&module, tail.ty)), item, "{stem}: the list of {name}");
                }
                None => assert_eq!((*span as usize, None), (ours.size, ours.tail.clone()), "{stem}: size of {name}"),
            }
            let member =
                |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize, leaf(&module, m.ty));
            let theirs: Vec<_> = members.iter().map(member).collect();
            let ours: Vec<_> = ours.members.iter().map(|(name, offset, ty)| (name.to_string(), *offset, *ty)).collect();
            assert_eq!(theirs, ours, "{stem}: members of {name}");
            compared += 1;
        }
    }
    assert!(compared > 20, "{compared} structs compared");
}

/// Value of a module's constant.
fn wgsl_constant(module: &naga::Module, name: &str) -> Option<f64> {
    let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name))?;
    match module.global_expressions[constant.init] {
        naga::Expression::Literal(naga::Literal::F32(v)) => Some(f64::from(v)),
        naga::Expression::Literal(naga::Literal::U32(v)) => Some(f64::from(v)),
        _ => None,
    }
}

/// A kernel's twin is where its declaration says.
#[test]
fn twins_are_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for Interface { stem, twin, .. } in interfaces() {
        match twin {
            Some(twin) => assert!(root.join(twin).is_file(), "{stem}: there is no {twin}"),
            None => assert_eq!(stem, "doctor", "{stem} has no twin"),
        }
        assert!(root.join(format!("src/gpu/{stem}.rs")).is_file(), "{stem} has no host file");
    }
}

/// Constants that only a shader has, and why.
const OWN: [(&str, &str); 3] = [
    ("REST_UNIT", "sums of integers do not depend on their order; the twin adds up f64 in one order"),
    ("REST_MOST", "as REST_UNIT: what keeps the sum within 32 bits"),
    ("SETTLED", "the resolution of f32; the twin has that of f64"),
];

#[test]
fn constants_are_those_of_the_twins() {
    use interslice::gpu::layout;
    use interslice::grid::{stencil, tiled};
    use interslice::reference::{distance, exact, extend, part, particles, propagate, reinit, scatter, trace};
    use interslice::reference::{
        fairing_flatness as flatness, fairing_limit as limit, fairing_near as near, fairing_transform as transform,
    };
    use interslice::registration::{displacement, motion_field as field};
    // Of one module, or of all that have it.
    let wanted: &[(&str, &str, f64)] = &[
        ("", "NONE", f64::from(layout::NONE)),
        ("", "RUNNING", f64::from(layout::RUNNING)),
        ("", "DONE", f64::from(layout::DONE)),
        ("", "VANISHED", f64::from(layout::VANISHED)),
        ("", "BLOCK", layout::BLOCK as f64),
        ("", "GRID", f64::from(layout::GRID)),
        ("", "PATCH", layout::PATCH as f64),
        ("", "TILE", layout::TILE as f64),
        ("", "TILE", field::CELL as f64),
        ("", "STRIDE", displacement::BLOCK as f64),
        ("", "FAR", interslice::grid::field::FAR),
        ("", "EPSILON", stencil::EPSILON),
        ("", "REACH", stencil::REACH as f64),
        ("", "FRONT_REACH", stencil::FRONT_REACH),
        ("", "COURANT", stencil::COURANT),
        ("band", "RIM", interslice::reference::band::RIM as f64),
        ("band", "SCAN_MOST", f64::from(interslice::gpu::kernels::SCAN_WIDTH)),
        ("compose", "DISAGREEMENT", interslice::backend::jobs::DISAGREEMENT),
        ("displacement", "MOMENTS", layout::MOMENTS as f64),
        ("displacement", "EVIDENCE", layout::EVIDENCE as f64),
        ("displacement", "CHANGES", layout::CHANGES as f64),
        ("distance", "TRUSTED", distance::TRUSTED),
        ("exact", "TIE", exact::TIE),
        ("extend", "ALIKE", extend::ALIKE),
        ("", "SQUARE", tiled::SQUARE as f64),
        ("", "AREA", tiled::AREA as f64),
        ("", "APART", displacement::BLOCK as f64),
        ("", "NEAR", f64::from(near::NEAR)),
        ("", "SATURATED", f64::from(near::SATURATED)),
        ("", "FADE", f64::from(near::FADE[0])),
        ("", "FADED", f64::from(near::FADE[1])),
        ("", "SLACK_PX", f64::from(limit::SLACK)),
        ("fairing_transform", "TANH_END", f64::from(transform::FLAT)),
        ("fairing_transform", "LEAST_GRADIENT", f64::from(transform::LEAST_GRADIENT)),
        ("fairing_transform", "ALONE_STEEP", flatness::STEEP),
        ("fairing_transform", "ALONE_FLAT", flatness::FLAT),
        ("fairing_transform", "STEEP", field::STEEP),
        ("fairing_transform", "FLAT", field::FLAT),
        ("fairing_transform", "LYING", flatness::NONE),
        ("fairing_transform", "STANDING", flatness::ALL),
        ("fairing_transform", "BLOCKS", layout::BLOCKS as f64),
        ("fairing_paths", "BACK_PASSES", (field::PASSES / 2) as f64),
        ("fairing_paths", "FROM_LOWER", f64::from(layout::FROM_LOWER)),
        ("fairing_paths", "FROM_UPPER", f64::from(layout::FROM_UPPER)),
        ("fairing_paths", "OVER_BOTH", f64::from(layout::OVER_BOTH)),
        ("", "TABLE", layout::TABLE as f64),
        ("", "ACROSS", (layout::TABLE as f64).sqrt()),
        ("", "SLOPE", 1.0),
        ("", "DIFFERENCE", f64::from(layout::DIFFERENCE)),
        ("", "CORRECTION", f64::from(layout::CORRECTION)),
        ("fairing_correct", "ALONE", limit::ALONE[0]),
        ("fairing_correct", "ALONE_END", limit::ALONE[1]),
        ("fairing_correct", "ROOT_END", f64::from(limit::ROOT_END)),
        ("fairing_layer", "LEAST", f64::from(f32::MIN_POSITIVE)),
        ("moving_layer", "SHRINKING", field::SHRINKING),
        ("moving_layer", "AT_TIP", interslice::contour::caps::AT_TIP),
        ("moving_slopes", "BOTH", f64::from(layout::BOTH)),
        ("moving_slopes", "ABOVE", f64::from(layout::ABOVE)),
        ("moving_slopes", "BELOW", f64::from(layout::BELOW)),
        ("part", "BOTH", part::BOTH),
        ("particles", "LOST", particles::LOST),
        ("particles", "OFF_FRONT", particles::OFF_FRONT),
        ("particles", "PROJECTIONS", particles::PROJECTIONS as f64),
        ("propagate", "STEP_LIMIT", propagate::STEP_LIMIT),
        ("propagate", "ALMOST", propagate::ALMOST),
        ("propagate", "ERROR_LIMIT", propagate::ERROR_LIMIT),
        ("propagate", "GAIN", propagate::GAIN),
        ("propagate", "LEAST_TIME", propagate::LEAST_TIME),
        ("propagate", "LATE", propagate::LATE),
        ("propagate", "LATE_RAMP", propagate::LATE_RAMP),
        ("reinit", "STEP", reinit::STEP),
        ("scatter", "RADIUS", scatter::RADIUS),
        ("scatter", "FILL_ROUNDS", scatter::FILL_ROUNDS as f64),
        ("trace", "STEP_LIMIT", trace::STEP_LIMIT),
        ("trace", "STALL_BELOW", trace::STALL_BELOW),
        ("trace", "LEAST_GAIN", trace::LEAST_GAIN),
        ("trace", "PATIENCE", trace::PATIENCE),
        ("trace", "SLACK", trace::SLACK),
        ("", "PASSES", displacement::PASSES as f64),
    ];
    let modules: Vec<_> = shaders().into_iter().map(|s| (s.declared.stem, s.module)).collect();
    let mut compared = BTreeSet::new();
    for (stem, name, value) in wanted {
        let of = modules.iter().filter(|(s, _)| stem.is_empty() || s == stem);
        let found: Vec<_> = of.filter_map(|(s, module)| Some((*s, wgsl_constant(module, name)?))).collect();
        assert!(!found.is_empty(), "no shader `{stem}` has a constant {name}");
        for (s, found) in found {
            assert!((found - value).abs() <= 1e-7 * value.abs(), "{s}: {name} is {found}, the twin has {value}");
            compared.insert(format!("{s}.{name}"));
        }
    }
    let mut unknown = BTreeSet::new();
    for (stem, module) in &modules {
        for name in module.constants.iter().filter_map(|(_, c)| c.name.as_deref()) {
            let full = format!("{stem}.{name}");
            if !compared.contains(&full) && !OWN.iter().any(|(own, _)| *own == name) {
                unknown.insert(full);
            }
        }
    }
    assert!(unknown.is_empty(), "constants that nothing compares: {unknown:?}");
}
