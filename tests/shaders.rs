//! The shaders as naga sees them: valid without any capability, structs laid out as the host mirrors them, constants as in the reference.
#![cfg(feature = "gpu")]

use std::collections::BTreeSet;

use interslice::gpu::kernels::{MODULES, PART};
use interslice::gpu::layout::{
    Axis, Block, Colour, Copy, Image, Interval, Item, Iteration, Job, Knot, Layout, Params, Part, Particle, Patch,
    Rule, Seed, Source, Span, Stage, Sums, Time, Work,
};
use naga::valid::{Capabilities, ValidationFlags, Validator};

fn parsed() -> Vec<(&'static str, naga::Module)> {
    MODULES
        .iter()
        .chain([&PART])
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
    // Whatever else the shaders lay out in buffers must be known here.
    let written_by_shaders_alone = ["Copies", "Reached", "Values", "Rounds", "Round", "Side"];
    let known = |name: &str| seen.contains(name) || written_by_shaders_alone.contains(&name);
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

#[test]
fn constants_are_those_of_the_twins() {
    use interslice::gpu::layout;
    use interslice::reference::{distance, exact, extend, part, particles, propagate, reinit, scatter, trace};
    use interslice::registration::{displacement, motion_field as field};
    let wanted: &[(&str, &str, f64)] = &[
        ("trace", "STEP_LIMIT", trace::STEP_LIMIT),
        ("trace", "NEAR", trace::NEAR),
        ("trace", "STALL_BELOW", trace::STALL_BELOW),
        ("trace", "LEAST_GAIN", trace::LEAST_GAIN),
        ("trace", "PATIENCE", trace::PATIENCE),
        ("trace", "COURANT", interslice::grid::stencil::COURANT),
        ("trace", "SLACK", trace::SLACK),
        ("part", "BOTH", part::BOTH),
        ("extend", "ALIKE", extend::ALIKE),
        ("propagate", "STEP_LIMIT", propagate::STEP_LIMIT),
        ("propagate", "ALMOST", propagate::ALMOST),
        ("propagate", "NEAR", propagate::NEAR),
        ("propagate", "ERROR_LIMIT", propagate::ERROR_LIMIT),
        ("propagate", "GAIN", propagate::GAIN),
        ("propagate", "LEAST_TIME", propagate::LEAST_TIME),
        ("particles", "LOST", particles::LOST),
        ("particles", "OFF_FRONT", particles::OFF_FRONT),
        ("particles", "PROJECTIONS", particles::PROJECTIONS as f64),
        ("reinit", "STEP", reinit::STEP),
        ("scatter", "RADIUS", scatter::RADIUS),
        ("scatter", "FILL_ROUNDS", scatter::FILL_ROUNDS as f64),
        ("distance", "TRUSTED", distance::TRUSTED),
        ("exact", "TIE", exact::TIE),
        ("compose", "DISAGREEMENT", interslice::backend::jobs::DISAGREEMENT),
        ("hj_step", "EPSILON", interslice::grid::stencil::EPSILON),
        ("hj_step", "REACH", interslice::grid::stencil::REACH as f64),
        ("band", "RIM", interslice::reference::band::RIM as f64),
        ("band", "BLOCK", interslice::gpu::layout::BLOCK as f64),
        ("band", "GRID", f64::from(interslice::gpu::layout::GRID)),
        ("distance", "PATCH", interslice::gpu::layout::PATCH as f64),
        ("part", "PATCH", interslice::gpu::layout::PATCH as f64),
        ("displacement", "STRIDE", displacement::BLOCK as f64),
        ("trajectories", "STRIDE", displacement::BLOCK as f64),
        ("moving_slopes", "STRIDE", displacement::BLOCK as f64),
        ("moving_layer", "STRIDE", displacement::BLOCK as f64),
        ("displacement", "TILE", layout::TILE as f64),
        ("moving_slopes", "TILE", layout::TILE as f64),
        ("moving_layer", "TILE", layout::TILE as f64),
        ("moving_layer", "TILE", field::CELL as f64),
        ("displacement", "MOMENTS", layout::MOMENTS as f64),
        ("displacement", "EVIDENCE", layout::EVIDENCE as f64),
        ("displacement", "CHANGES", layout::CHANGES as f64),
        ("trajectories", "PASSES", displacement::PASSES as f64),
        ("moving_slopes", "BOTH", f64::from(layout::BOTH)),
        ("moving_slopes", "ABOVE", f64::from(layout::ABOVE)),
        ("moving_slopes", "BELOW", f64::from(layout::BELOW)),
        ("moving_layer", "SHRINKING", field::SHRINKING),
    ];
    let modules = parsed();
    for (stem, name, value) in wanted {
        let (_, module) = modules.iter().find(|(s, _)| s == stem).expect("a known module");
        let found = wgsl_constant(module, name).unwrap_or_else(|| panic!("{stem} has no constant {name}"));
        assert!((found - value).abs() <= 1e-7 * value.abs(), "{stem}: {name} is {found}, the twin has {value}");
    }
}
