//! The shaders as naga sees them: valid without any capability; variables, structs and constants as the host declares them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use interslice::gpu::kernels::{Access, Binding, Interface, interfaces, overrides};
use interslice::gpu::layout::GRID;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use naga::{AddressSpace, ScalarKind, StorageAccess, TypeInner};
use serde_json::json;

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

/// Text, entry points, overrides and bindings of every shader, for `tests/webgpu.py`: written to `shaders.json` in the target folder's `tmp`.
#[test]
fn shaders_are_written_for_other_compilers() {
    let entry = |shader: &Shader, entry: &interslice::gpu::kernels::Entry| {
        let place = |b: &Binding| {
            let named = |(_, v): (_, &naga::GlobalVariable)| {
                (v.name.as_deref() == Some(b.name)).then(|| v.binding.as_ref().map(|at| at.binding)).flatten()
            };
            let binding = shader.module.global_variables.iter().find_map(named).expect("a binding");
            json!({ "binding": binding, "access": format!("{:?}", b.access) })
        };
        let set = |name: &str| shader.module.overrides.iter().any(|(_, o)| o.name.as_deref() == Some(name));
        let constants: BTreeMap<&str, f64> = overrides(GRID).into_iter().filter(|(name, _)| set(name)).collect();
        let bindings: Vec<_> = entry.bindings.iter().map(place).collect();
        json!({ "name": entry.name, "constants": constants, "bindings": bindings })
    };
    let of = |shader: Shader| {
        let entries: Vec<_> = shader.declared.entries.iter().map(|e| entry(&shader, e)).collect();
        json!({ "stem": shader.declared.stem, "text": shader.declared.text, "entries": entries })
    };
    let shaders: Vec<_> = shaders().into_iter().map(of).collect();
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("shaders.json");
    std::fs::write(file, serde_json::to_vec(&shaders).expect("JSON")).expect("the target folder can be written to");
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

/// Value of a module's constant, or of an override where the host sets none.
fn wgsl_constant(module: &naga::Module, name: &str) -> Option<f64> {
    let constant = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).map(|(_, c)| c.init);
    let preset = module.overrides.iter().find(|(_, o)| o.name.as_deref() == Some(name)).and_then(|(_, o)| o.init);
    match module.global_expressions[constant.or(preset)?] {
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

/// Every loop has an end that no value of a field decides: a count, or bits of which each trip takes one away. Compilers for GPUs may take NaN for
/// any number.
#[test]
fn loops_end() {
    let counted = |header: &str| {
        let compares = |c: &str| [" < ", " <= ", " > "].iter().any(|sign| c.contains(sign));
        header.starts_with("for (var ") && header.split(';').nth(1).is_some_and(compares)
    };
    let known = [
        "while bits != 0u {",
        "while awoken != 0u {",
        "while count > 0u {",
        "while k + 1u < count && begins[row + k + 1u] < f32(i) - TIE {",
        "while jobs_mut[q].next_time < jobs_mut[q].time_count {",
    ];
    let mut seen = BTreeSet::new();
    for Interface { stem, text, .. } in interfaces() {
        for line in text.lines().map(str::trim).filter(|l| ["loop", "while", "for ("].iter().any(|w| l.starts_with(w)))
        {
            assert!(counted(line) || known.contains(&line), "{stem}: does `{line}` end whatever the numbers are?");
            seen.insert(line);
        }
    }
    assert!(known.iter().all(|k| seen.contains(k)) && seen.len() > 15, "{seen:?}");
    assert!(!counted("for (;;) {") && !counted("for (var v = 1.0; v != 0.0; v *= 0.5) {"), "others are seen");
}

/// Constants that only a shader has, and why.
const OWN: [(&str, &str); 12] = [
    ("REST_UNIT", "sums of integers do not depend on their order; the twin adds up f64 in one order"),
    ("REST_MOST", "as REST_UNIT: what keeps the sum within 32 bits"),
    ("MOST_STEPS", "f32 to u32 must not overflow; the twin's steps are counted in usize"),
    ("UNKNOWN", "the twin keeps a list of those"),
    ("SETTLED", "the resolution of f32; the twin has that of f64"),
    ("SIDE", "a patch with its border; the twin has none"),
    ("UPDATES", "turns that patches take; the twin sweeps whole images"),
    ("WEST", "news of a patch, as the three others and MOVES"),
    ("EAST", "as WEST"),
    ("SOUTH", "as WEST"),
    ("NORTH", "as WEST"),
    ("MOVES", "as WEST"),
];

#[test]
fn constants_are_those_of_the_twins() {
    use interslice::gpu::layout;
    use interslice::grid::{near_knots, stencil};
    use interslice::reference::{
        distance, exact, extend, morph_layer, part, particles, propagate, reinit, scatter, trace,
    };
    use interslice::registration::{cells, displacement, particle_weight, value_curve};
    // Of one module, or of all that have it.
    let wanted: &[(&str, &str, f64)] = &[
        ("", "NONE", f64::from(layout::NONE)),
        ("", "RUNNING", f64::from(layout::RUNNING)),
        ("", "DONE", f64::from(layout::DONE)),
        ("", "VANISHED", f64::from(layout::VANISHED)),
        ("", "BLOCK", layout::BLOCK as f64),
        ("", "grid", f64::from(layout::GRID)),
        ("", "PATCH", layout::PATCH as f64),
        ("", "TILE", layout::TILE as f64),
        ("", "TILE", cells::CELL as f64),
        ("", "STRIDE", displacement::BLOCK as f64),
        ("", "FAR", interslice::grid::field::FAR),
        ("", "EPSILON", stencil::EPSILON),
        ("", "REACH", stencil::REACH as f64),
        ("", "FRONT_REACH", stencil::FRONT_REACH),
        ("", "COURANT", stencil::COURANT),
        ("band", "EIGHTH", layout::EIGHTH as f64),
        ("band", "RIM", interslice::reference::band::RIM as f64),
        ("band", "SCAN_MOST", f64::from(interslice::gpu::kernels::SCAN_WIDTH)),
        ("compose", "DISAGREEMENT", interslice::backend::jobs::DISAGREEMENT),
        ("displacement", "MOMENTS", layout::MOMENTS as f64),
        ("distance", "PATCHES", layout::PATCHES as f64),
        ("displacement", "EVIDENCE", layout::EVIDENCE as f64),
        ("displacement", "CHANGES", layout::CHANGES as f64),
        ("distance", "TRUSTED", distance::TRUSTED),
        ("exact", "TIE", exact::TIE),
        ("extend", "ALIKE", extend::ALIKE),
        ("", "SHRINKING", value_curve::SHRINKING),
        ("", "UNLIKE", near_knots::UNLIKE),
        ("", "WHOLLY", near_knots::WHOLLY),
        ("", "AT_TIP", interslice::contour::caps::AT_TIP),
        ("morph_layer", "ALL_TRUST", particle_weight::ALL),
        ("morph_layer", "GONE", f64::from(morph_layer::GONE)),
        ("morph_layer", "NO_TRUST", particle_weight::NONE),
        ("morph_layer", "OF_ENDS", f64::from(layout::OF_ENDS)),
        ("morph_layer", "OF_SLICES", f64::from(layout::OF_SLICES)),
        ("morph_layer", "SQUARE", interslice::grid::sparse_image::SQUARE as f64),
        ("moving_slopes", "BOTH", f64::from(layout::BOTH)),
        ("moving_slopes", "ABOVE", f64::from(layout::ABOVE)),
        ("moving_slopes", "BELOW", f64::from(layout::BELOW)),
        ("part", "BOTH", part::BOTH),
        ("particles", "LOST", particles::LOST),
        ("particles", "WHOLE", particles::WHOLE),
        ("particles", "OFF_FRONT", particles::OFF_FRONT),
        ("particles", "PRIOR", particles::PRIOR),
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
        ("trace", "STEP_LIMIT", trace::STEP_LIMIT),
        ("trace", "NOWHERE", f64::from(layout::NOWHERE)),
        ("trace", "STALL_BELOW", trace::STALL_BELOW),
        ("trace", "LEAST_GAIN", trace::LEAST_GAIN),
        ("trace", "PATIENCE", trace::PATIENCE),
        ("trace", "SLACK", trace::SLACK),
        ("trajectories", "PASSES", displacement::PASSES as f64),
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
