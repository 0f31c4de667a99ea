"""Every shader in headless Chromium's WebGPU (Debian: chromium, chromium-driver), whose compiler is stricter than the others, on a device with
the default limits: no module has an error, and every pipeline can be created. Three shaders that are spoilt show that errors are seen.

    python webgpu.py <shaders.json, written by `cargo test --test gpu shaders`>
"""

import json
import shutil
import sys
import tempfile
from pathlib import Path

from selenium import webdriver

FLAGS = ["headless=new", "no-sandbox", "disable-dev-shm-usage", "enable-unsafe-webgpu", "use-webgpu-adapter=swiftshader", "enable-unsafe-swiftshader"]

COMPILE = """
const [shaders, done] = arguments;
(async () => {
  const adapter = await navigator.gpu?.requestAdapter();
  if (!adapter) return {none: "no WebGPU adapter"};
  const device = await adapter.requestDevice();
  const out = {adapter: `${adapter.info.vendor} ${adapter.info.architecture}`, errors: [], modules: 0, pipelines: 0};
  const types = {Uniform: "uniform", Read: "read-only-storage", Write: "storage"};
  for (const {stem, text, entries} of shaders) {
    device.pushErrorScope("validation");
    const module = device.createShaderModule({code: text});
    const messages = (await module.getCompilationInfo()).messages.filter(m => m.type === "error");
    out.errors.push(...messages.map(m => `${stem}, line ${m.lineNum}: ${m.message}`));
    await device.popErrorScope();
    out.modules += 1;
    if (messages.length) continue;
    for (const {name, constants, bindings} of entries) {
      device.pushErrorScope("validation");
      const layout = device.createBindGroupLayout({entries: bindings.map(({binding, access}) =>
        ({binding, visibility: GPUShaderStage.COMPUTE, buffer: {type: types[access]}}))});
      const pipeline = {layout: device.createPipelineLayout({bindGroupLayouts: [layout]}), compute: {module, entryPoint: name, constants}};
      try { await device.createComputePipelineAsync(pipeline); out.pipelines += 1; }
      catch (e) { out.errors.push(`${stem}.${name}: ${e.message}`); }
      const e = await device.popErrorScope();
      if (e) out.errors.push(`${stem}.${name}: ${e.message}`);
    }
  }
  return out;
})().then(done, e => done({none: String(e)}));
"""


def check(name, holds, value=""):
    if not holds:
        sys.exit(f"{name}: wrong {value}")
    print(f"{name}: ok {value}")


def browser():
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
        options.add_argument(f"--{flag}")
    options.binary_location = shutil.which("chromium")
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    driver.set_script_timeout(300)
    return driver


def compile_all(driver, shaders):
    found = driver.execute_async_script(COMPILE, shaders)
    check("WebGPU", "none" not in found, found.get("none", ""))
    return found


def spoilt(shaders):
    """A wrong type, a variable that is written but bound to be read, a barrier that not all of a workgroup reach."""
    by_stem = {s["stem"]: s for s in shaders}
    exact, band = by_stem["exact"], by_stem["band"]
    columns = next(e for e in exact["entries"] if e["name"] == "columns")
    read = [{**b, "access": "Read" if b["access"] == "Write" else b["access"]} for b in columns["bindings"]]
    barrier = "    workgroupBarrier();\n"
    assert "var run = FAR;" in exact["text"] and barrier in band["text"]
    return {
        "a wrong type": {**exact, "text": exact["text"].replace("var run = FAR;", "var run: u32 = FAR;")},
        "a wrong access": {**exact, "entries": [{**columns, "bindings": read}]},
        "a barrier that some miss": {**band, "text": band["text"].replace(barrier, f"    if totals[local] > 0u {{\n    {barrier}    }}\n", 1)},
    }


def main(path):
    shaders = json.loads(Path(path).read_text())
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text("<!doctype html><title>shaders</title>")
        driver = browser()
        try:
            driver.get(page.as_uri())
            found = compile_all(driver, shaders)
            check("errors", not found["errors"], found["errors"])
            entries = sum(len(s["entries"]) for s in shaders)
            check("modules and pipelines", (found["modules"], found["pipelines"]) == (len(shaders), entries), f"{len(shaders)}, {entries} on {found['adapter']}")
            for name, shader in spoilt(shaders).items():
                errors = compile_all(driver, [shader])["errors"]
                check(f"{name} is seen", len(errors) > 0, errors[:1])
        finally:
            driver.quit()


if __name__ == "__main__":
    main(*sys.argv[1:])
