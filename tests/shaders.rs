//! The shaders as naga sees them: valid without any capability, structs laid out as the host mirrors them, constants as in the reference.
#![cfg(feature = "gpu")]

use std::collections::BTreeSet;

use interslice::gpu::layout::{
    Axis, Block, Colour, Copy, Image, Interval, Item, Iteration, Job, Knot, Layout, Params, Part, Particle, Patch,
    Reached, Read, Round, Rounds, Rule, Seed, Side, Source, Span, Stage, Sums, Time, Values, Work,
};
use interslice::gpu::shaders::MODULES;
use naga::valid::{Capabilities, ValidationFlags, Validator};

fn parsed() -> Vec<(&'static str, naga::Module)> {
    MODULES
        .iter()
        .map(|(stem, text)| match naga::front::wgsl::parse_str(text) {
            Ok(module) => (*stem, module),
            Err(e) => panic!("{}", e.emit_to_string_with_path(text, stem)),
        })
        .collect()
}

#[test]
fn every_shader_is_valid_without_capabilities() {
    for (stem, module) in parsed() {
        let result = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
        assert!(result.is_ok(), "{stem}: {:?}", result.err());
        assert!(!module.entry_points.is_empty(), "{stem} has entry points");
    }
}

/// Size of a type and, for structs, the offsets of its members by name.
fn wgsl_struct(module: &naga::Module, name: &str) -> Option<(u32, Vec<(String, usize)>)> {
    let (_, ty) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name))?;
    let naga::TypeInner::Struct { members, span } = &ty.inner else { return None };
    Some((*span, members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize)).collect()))
}

/// Compares a mirrored struct with every module that has it; a run-time array at its end belongs to the shader alone.
fn mirrors<T: Layout>(seen: &mut BTreeSet<&'static str>) {
    let mut found = 0;
    for (stem, module) in parsed() {
        let Some((span, mut members)) = wgsl_struct(&module, T::NAME) else { continue };
        let ours: Vec<(String, usize)> = T::members().into_iter().map(|(n, o)| (n.to_string(), o)).collect();
        let open_ended = members.len() == ours.len() + 1;
        if open_ended {
            assert_eq!(
                members.pop().map(|m| m.1),
                Some(size_of::<T>()),
                "{stem}: where the list of {} begins",
                T::NAME
            );
        }
        assert_eq!(members, ours, "{stem}: members of {}", T::NAME);
        assert!(open_ended || span as usize == size_of::<T>(), "{stem}: size of {}", T::NAME);
        found += 1;
    }
    assert!(found > 0, "no shader has a struct {}", T::NAME);
    seen.insert(T::NAME);
}

#[test]
fn structs_are_laid_out_as_the_host_mirrors_them() {
    let mut seen = BTreeSet::new();
    mirrors::<Params>(&mut seen);
    mirrors::<Job>(&mut seen);
    mirrors::<Block>(&mut seen);
    mirrors::<Sums>(&mut seen);
    mirrors::<Work>(&mut seen);
    mirrors::<Stage>(&mut seen);
    mirrors::<Particle>(&mut seen);
    mirrors::<Source>(&mut seen);
    mirrors::<Seed>(&mut seen);
    mirrors::<Copy>(&mut seen);
    mirrors::<Item>(&mut seen);
    mirrors::<Patch>(&mut seen);
    mirrors::<Colour>(&mut seen);
    mirrors::<Rule>(&mut seen);
    mirrors::<Image>(&mut seen);
    mirrors::<Iteration>(&mut seen);
    mirrors::<Axis>(&mut seen);
    mirrors::<Interval>(&mut seen);
    mirrors::<Time>(&mut seen);
    mirrors::<Knot>(&mut seen);
    mirrors::<Span>(&mut seen);
    mirrors::<Part>(&mut seen);
    mirrors::<Side>(&mut seen);
    mirrors::<Reached>(&mut seen);
    mirrors::<Read>(&mut seen);
    mirrors::<Values>(&mut seen);
    mirrors::<Rounds>(&mut seen);
    mirrors::<Round>(&mut seen);
    // Whatever else the shaders lay out in buffers must be known here.
    let known = |name: &str| seen.contains(name);
    for (stem, module) in parsed() {
        for (_, variable) in module.global_variables.iter() {
            let ty = &module.types[variable.ty];
            let ty = match ty.inner {
                naga::TypeInner::Array { base, .. } => &module.types[base],
                _ => ty,
            };
            if let (naga::TypeInner::Struct { .. }, Some(name)) = (&ty.inner, &ty.name) {
                assert!(known(name), "{stem}: struct {name} has no mirror");
            }
        }
    }
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

/// Constants that only a shader has, and why.
const OWN: [(&str, &str); 3] = [
    ("REST_UNIT", "sums of integers do not depend on their order; the twin adds up f64 in one order"),
    ("REST_MOST", "as REST_UNIT: what keeps the sum within 32 bits"),
    ("SETTLED", "the resolution of f32; the twin has that of f64"),
];

#[test]
fn constants_are_those_of_the_twins() {
    use interslice::gpu::layout;
    use interslice::grid::stencil;
    use interslice::reference::{distance, exact, extend, part, particles, propagate, reinit, scatter, trace};
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
        ("trajectories", "PASSES", displacement::PASSES as f64),
    ];
    let modules = parsed();
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
