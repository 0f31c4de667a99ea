//! `--profile`: what stages and kernels have cost, for people.

use interslice::report::{DeviceUse, Profile, StageCost};

/// Stages in their order, for people.
fn tell_stages(stages: &[StageCost]) {
    let Some(first) = stages.first() else { return };
    let line = |stage: &StageCost| {
        let seconds = |s: Option<f64>| s.map_or("-".into(), |s| format!("{s:.3}"));
        let DeviceUse { waits, submits, dispatches, buffers, bytes_up, bytes_down, .. } = stage.device;
        let [up, down] = [bytes_up, bytes_down].map(|bytes| bytes as f64 * 1e-6);
        tell!(
            "{:>20} {:>10} {:>8} {waits:>6} {submits:>8} {dispatches:>11} {buffers:>8} {up:>8.1} {down:>8.1}",
            stage.name,
            seconds(stage.host_seconds),
            seconds(stage.serial_seconds)
        );
    };
    tell!(
        "{:>20} {:>10} {:>8} {:>6} {:>8} {:>11} {:>8} {:>8} {:>8}",
        "stage",
        "host CPU s",
        "serial s",
        "waits",
        "submits",
        "dispatches",
        "buffers",
        "MB up",
        "MB down"
    );
    stages.iter().for_each(line);
    let mut all = StageCost { name: "all".into(), ..first.clone() };
    stages[1..].iter().for_each(|stage| all.add(stage));
    line(&all);
    let threads = all.device.threads.iter().enumerate().filter(|(_, count)| **count > 0);
    let words: Vec<String> = threads.map(|(k, count)| format!("{count} from {}", 1u64 << (2 * k))).collect();
    tell!("threads of the dispatches, by powers of 4: {}", words.join(", "));
}

/// Stages, and kernels by cost, for people.
pub fn tell_profile(profile: &Profile) {
    tell_stages(&profile.stages);
    let mut kernels: Vec<_> = profile.kernels.iter().collect();
    kernels.sort_by(|a, b| b.1.seconds.total_cmp(&a.1.seconds));
    let total: f64 = kernels.iter().map(|(_, k)| k.seconds).sum();
    let dispatches: u64 = kernels.iter().map(|(_, k)| k.dispatches).sum();
    tell!("{:>20} {:>10} {:>7} {:>11} {:>10} {:>8}", "kernel", "GPU ms", "share", "dispatches", "us each", "Mpx/s");
    for (name, k) in kernels {
        let rate = if k.pixels > 0 && k.seconds > 0.0 {
            format!("{:8.1}", k.pixels as f64 / k.seconds * 1e-6)
        } else {
            "       -".into()
        };
        tell!(
            "{name:>20} {:10.2} {:6.1}% {:>11} {:10.1} {rate}",
            1e3 * k.seconds,
            if total > 0.0 { 100.0 * k.seconds / total } else { 0.0 },
            k.dispatches,
            1e6 * k.seconds / k.dispatches.max(1) as f64
        );
    }
    tell!(
        "{:.1} GPU ms in {dispatches} dispatches and {} submissions; {:.1} MB sent, {:.1} MB read back",
        1e3 * total,
        profile.submissions,
        profile.bytes_up as f64 * 1e-6,
        profile.bytes_down as f64 * 1e-6
    );
    if let Some(busy) = profile.busy.filter(|busy| busy.of_seconds > 0.0) {
        tell!(
            "the device had work in {:.1} % of the {:.2} s from its first kernel to its last",
            100.0 * busy.seconds / busy.of_seconds,
            busy.of_seconds
        );
    }
}
