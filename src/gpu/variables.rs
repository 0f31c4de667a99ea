//! The variables that each kernel binds, by name, number and type, as naga reads them in the shaders.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
use wgpu::naga::{GlobalVariable, Handle, Module, ScalarKind, Type, TypeInner, front};

use super::shaders::MODULES;

/// A variable of a shader that a kernel uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Variable {
    /// Name in the shader.
    pub name: String,
    /// Number of its binding, in group 0.
    pub binding: u32,
    /// Type of it, of its elements if it is an array: `f32`, `vec2<u32>`, the name of a struct.
    pub element: String,
}

/// Variables by module and entry point.
type Table = BTreeMap<(&'static str, String), Vec<Variable>>;

static TABLE: LazyLock<Result<Table, String>> = LazyLock::new(|| {
    let mut table = Table::new();
    for (stem, text) in MODULES {
        read(stem, text, &mut table).map_err(|e| format!("shader `{stem}`: {e}"))?;
    }
    Ok(table)
});

/// The variables that an entry point uses.
///
/// # Errors
/// In words: a shader that is not WGSL, or an entry point that is in none.
pub fn variables(module: &str, entry: &str) -> Result<&'static [Variable], String> {
    let table = TABLE.as_ref().map_err(String::clone)?;
    let found = table.iter().find(|((stem, name), _)| *stem == module && name == entry);
    found.map(|(_, variables)| variables.as_slice()).ok_or_else(|| format!("shader `{module}` has no kernel `{entry}`"))
}

fn read(stem: &'static str, text: &str, table: &mut Table) -> Result<(), String> {
    let module = front::wgsl::parse_str(text).map_err(|e| e.emit_to_string(text))?;
    let mut validator = Validator::new(ValidationFlags::default(), Capabilities::empty());
    let info = validator.validate(&module).map_err(|e| e.emit_to_string(text))?;
    for (number, entry) in module.entry_points.iter().enumerate() {
        let used = info.get_entry_point(number);
        let of_kernel = |(handle, variable): (Handle<GlobalVariable>, &GlobalVariable)| {
            let binding = variable.binding.filter(|_| !used[handle].is_empty())?.binding;
            Some(Variable { name: variable.name.clone()?, binding, element: element(&module, variable.ty) })
        };
        table.insert((stem, entry.name.clone()), module.global_variables.iter().filter_map(of_kernel).collect());
    }
    Ok(())
}

/// A type as WGSL writes it; of an array its elements'.
fn element(module: &Module, ty: Handle<Type>) -> String {
    let scalar = |kind: ScalarKind| match kind {
        ScalarKind::Float => "f32",
        ScalarKind::Uint => "u32",
        ScalarKind::Sint => "i32",
        _ => "bool",
    };
    let Type { name, inner } = &module.types[ty];
    match inner {
        TypeInner::Scalar(of) | TypeInner::Atomic(of) => scalar(of.kind).into(),
        TypeInner::Vector { size, scalar: of } => format!("vec{}<{}>", *size as u8, scalar(of.kind)),
        TypeInner::Array { base, .. } => element(module, *base),
        _ => name.clone().unwrap_or_default(),
    }
}
