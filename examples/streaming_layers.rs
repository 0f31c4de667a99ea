//! Areas of all layers of a stack, none of which is kept in memory: `cargo run --release --example streaming_layers examples/jacksboro`.

use std::path::Path;

use interslice::{
    Budget, Layer, Means, ReadOptions, Reference, Result, Settings, Silent, height_grid, read, reconstruct_into,
};

/// Height and area of every output layer, in the stack's unit.
pub fn run(input: &Path) -> Result<Vec<(f64, f64)>> {
    let stack = read(input, &ReadOptions::default())?;
    let settings = Settings::default();
    let heights = height_grid(&stack, &settings, None).heights()?;
    let pixel = stack.spacing[0] * stack.spacing[1];
    let mut areas = Vec::new();
    let mut sink = |layer: Layer| {
        if layer.output {
            let inside = layer.phi.iter().filter(|distance| **distance < 0.0).count();
            areas.push((layer.z, pixel * inside as f64));
        }
        Ok(())
    };
    // Slices beyond 256 MiB wait in a temporary file.
    let means = Means { backend: &Reference, progress: &Silent, budget: &Budget::of(256 << 20, 256 << 20) };
    reconstruct_into(&stack, &heights, &settings, &means, &mut sink)?;
    Ok(areas)
}

#[allow(dead_code, reason = "a test calls `run`")]
fn main() -> Result<()> {
    let Some(input) = std::env::args().nth(1) else {
        println!("usage: streaming_layers INPUT");
        return Ok(());
    };
    for (z, area) in run(Path::new(&input))? {
        println!("{z:10.3} {area:12.1}");
    }
    Ok(())
}
