//! The choice of a backend, a GPU with little memory, `devices` and `doctor`.

use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::files::*;

#[test]
fn backends_are_chosen_told_and_reported() {
    let place = folder();
    sound_stack(place.path());
    let input = place.path().display().to_string();
    let report = place.path().join("r.json").display().to_string();
    let run = |more: &[&str]| {
        // The driver's self-test is remembered here and nowhere else.
        let cache = place.path().join("cache");
        let mut program = Command::new(env!("CARGO_BIN_EXE_interslice"));
        program.env("XDG_CACHE_HOME", cache).args([&["reconstruct", &input, "--report", &report], more].concat());
        let result = program.output().expect("the program starts");
        let text = fs::read(&report).unwrap_or_default();
        let _ = fs::remove_file(&report);
        (result, serde_json::from_slice::<Value>(&text).unwrap_or_default())
    };
    let (cpu, told) = run(&["--backend", "cpu", "--profile", "--adapter", "0", "--gpu-memory", "1G"]);
    assert_eq!(cpu.status.code(), Some(0), "{}", stderr(&cpu));
    for setting in ["adapter", "gpu_memory"] {
        let says = format!("setting `{setting}` changes nothing: it is for a GPU");
        assert!(stderr(&cpu).contains(&says), "{}", stderr(&cpu));
    }
    assert!(stderr(&cpu).contains("setting `profile` changes nothing"), "{}", stderr(&cpu));
    assert!(told["backend"].as_str().is_some_and(|b| b.starts_with("reference")), "{told}");
    assert!(told["backend_reason"].as_str().is_some_and(|r| r.contains("asked for")), "{told}");
    let (gpu, told) = run(&["--backend", "gpu", "--profile"]);
    assert_eq!(gpu.status.code(), Some(0), "{}", stderr(&gpu));
    assert!(told["backend"].as_str().is_some_and(|b| b.starts_with("GPU ")), "{told}");
    let steps = &told["profile"]["kernels"]["hj_step"];
    assert!(steps["dispatches"].as_u64().is_some_and(|n| n > 30) && steps["pixels"].as_u64() > Some(1000), "{steps}");
    assert!(stderr(&gpu).contains("hj_step") && stderr(&gpu).contains("GPU ms"), "{}", stderr(&gpu));
    assert!(stderr(&gpu).contains("host CPU s") && stderr(&gpu).contains("propagate"), "{}", stderr(&gpu));
    let (plain, told) = run(&["--backend", "gpu", "--gpu-memory", "1G"]);
    assert!(!stderr(&plain).contains("changes nothing"), "{}", stderr(&plain));
    assert!(!stderr(&plain).contains("host CPU s"), "only where it is asked: {}", stderr(&plain));
    assert!(told["profile"]["stages"][0]["device"]["waits"].as_u64() > Some(0), "{}", told["profile"]);
    for (wrong, said) in
        [("--memory=lots", "512M"), ("--memory=1K", "at least 1M"), ("--backend=tpu", "auto, gpu, cpu")]
    {
        let (result, _) = run(&[wrong]);
        assert_eq!(result.status.code(), Some(2), "{wrong}");
        assert!(stderr(&result).contains(said), "{wrong}: {}", stderr(&result));
    }
    // lavapipe's name has `256 bits` in it: a number is no part of a name.
    for wrong in ["none such", "256"] {
        let (missing, _) = run(&["--backend", "gpu", "--adapter", wrong]);
        assert_eq!(missing.status.code(), Some(2));
        assert!(stderr(&missing).contains(&format!("got `{wrong}`")), "{}", stderr(&missing));
    }
}

#[test]
fn a_gpu_without_memory_fails_or_is_replaced() {
    let place = folder();
    let demos = place.path().display().to_string();
    let made = interslice(&["demo", "fig9", "-o", &demos, "--backend", "cpu"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let input = place.path().join("fig9").display().to_string();
    let report = place.path().join("r.json").display().to_string();
    let run = |more: &[&str]| {
        let result = interslice(&[&["reconstruct", &input, "--report", &report], more].concat());
        let text = fs::read(&report).unwrap_or_default();
        (result, serde_json::from_slice::<Value>(&text).unwrap_or_default())
    };
    // A budget that nothing fits into: an explicit GPU fails and leaves nothing, an automatic choice goes on.
    let (short, told) = run(&["--backend", "gpu", "--gpu-memory", "1M"]);
    assert_eq!(short.status.code(), Some(1), "{}", stderr(&short));
    assert!(stderr(&short).contains("budget of 1048576 bytes") && told.is_null(), "{}", stderr(&short));
    // With this little memory the driver's self-test may not fit either: it is run before, and remembered.
    let (seen, _) = run(&["--adapter", "0"]);
    assert!(stderr(&seen).contains("running on: GPU"), "{}", stderr(&seen));
    let (auto, told) = run(&["--adapter", "0", "--gpu-memory", "1M"]);
    assert_eq!(auto.status.code(), Some(0), "{}", stderr(&auto));
    assert!(stderr(&auto).contains("rest of the job runs on the CPU"), "{}", stderr(&auto));
    assert!(told["warnings"][0].as_str().is_some_and(|w| w.contains("changed on the way")), "{told}");
}

#[test]
fn devices_and_doctor_speak_in_words() {
    let listed = interslice(&["devices"]);
    let text = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(text.starts_with("0: ") && text.contains("--backend auto takes"), "{text}");
    let examined = interslice(&["doctor"]);
    let text = String::from_utf8_lossy(&examined.stdout).into_owned();
    assert_eq!(examined.status.code(), Some(0), "{text}");
    assert!(text.contains("loops: ") && text.contains("NaN: ") && text.contains("can be trusted."), "{text}");
    let nothing = interslice(&["doctor", "--backend", "cpu"]);
    assert_eq!(nothing.status.code(), Some(2), "{nothing:?}");
    assert!(stderr(&nothing).contains("nothing to test"), "{}", stderr(&nothing));
}
