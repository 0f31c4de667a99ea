"""The page of a report in headless Chromium (Debian: chromium, chromium-driver), on a desk and on a telephone, light and dark: no console
message, nothing loaded, the surface drawn, and it answers.

    python page.py <program> [folder for screenshots]
"""

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By

WINDOWS = {"desk": (1280, 900), "phone": (390, 844)}


def check(name, holds, value=""):
    if not holds:
        sys.exit(f"{name}: wrong {value}")
    print(f"{name}: ok {value}")


def browser(size):
    options = webdriver.ChromeOptions()
    flags = ["headless=new", "no-sandbox", "disable-dev-shm-usage", "use-gl=angle", "use-angle=swiftshader", "enable-unsafe-swiftshader", "hide-scrollbars"]
    for flag in [*flags, "force-prefers-reduced-motion", "window-size=1280,900"]:
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    options.binary_location = shutil.which("chromium")
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    # The page is drawn by the CPU, beside the tests.
    driver.set_script_timeout(300)
    width, height = size
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})
    return driver


def picture(element):
    return Image.open(io.BytesIO(element.screenshot_as_png)).convert("RGB")


def counts(image):
    """Pixels of the body's warm grey and of the red lines; different colours."""
    pixels = list(image.get_flattened_data() if hasattr(image, "get_flattened_data") else image.getdata())
    body = sum(r > g > b and r - b > 12 for r, g, b in pixels)
    red = sum(r > 100 and r > 2.2 * g and r > 2.2 * b for r, g, b in pixels)
    return body / len(pixels), red / len(pixels), len(set(pixels))


def differ(a, b):
    return sum(p != q for p, q in zip(a.tobytes(), b.tobytes())) / len(a.tobytes())


def examine(name, size, theme, page, shots):
    driver = browser(size)
    try:
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": theme}, {"name": "prefers-reduced-motion", "value": "reduce"}]})
        driver.get(page.as_uri())
        driver.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")
        if shots:
            driver.save_screenshot(str(shots / f"{name}-{theme}.png"))
        canvas = driver.find_element(By.ID, "view")
        # Where a part of it lies below the window's edge, a picture that scrolls to it is taken before what comes into sight is shown.
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
        driver.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")
        first = picture(canvas)
        body, red, colours = counts(first)
        check(f"{name} {theme}: the surface", body > 0.05 and red > 0.001 and colours > 500, f"{body:.3f} body, {red:.4f} lines, {colours} colours")
        wide = driver.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
        check(f"{name} {theme}: no sideways scrolling", wide[0] <= wide[1] == size[0], wide)
        check(f"{name} {theme}: nothing loaded", driver.execute_script("return performance.getEntriesByType('resource').length") == 0)
        ActionChains(driver).drag_and_drop_by_offset(canvas, 80, 20).perform()
        driver.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")
        turned = picture(canvas)
        check(f"{name} {theme}: dragging turns it", differ(first, turned) > 0.05, f"{differ(first, turned):.3f}")
        driver.find_element(By.ID, "lines").click()
        driver.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done));")
        without = counts(picture(canvas))[1]
        check(f"{name} {theme}: contours can be hidden", without < 0.2 * counts(turned)[1], f"{without:.4f}")
        messages = driver.get_log("browser")
        check(f"{name} {theme}: console is silent", not messages, messages)
        if shots:
            driver.execute_script("const s = document.querySelector('.stage').style; s.height = getComputedStyle(document.querySelector('.stage')).height")
            driver.find_element(By.ID, "lines").click()
            for part in driver.find_elements(By.TAG_NAME, "details"):
                driver.execute_script("arguments[0].open = true", part)
            height = driver.execute_script("return document.documentElement.scrollHeight")
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {"width": size[0], "height": height, "deviceScaleFactor": 1, "mobile": size[0] < 600})
            driver.save_screenshot(str(shots / f"{name}-{theme}-whole.png"))
    finally:
        driver.quit()


def main(program, shots=None):
    example = Path(__file__).parent.parent / "examples" / "jacksboro"
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "jacksboro.html"
        subprocess.run([program, "reconstruct", example, "--end-top", "extrapolate", "-o", page, "-q"], check=True)
        size = page.stat().st_size
        check("size of the page", size < 10e6, f"{size / 1e6:.1f} MB")
        for name, window in WINDOWS.items():
            for theme in ("light", "dark"):
                examine(name, window, theme, page, shots and Path(shots))


if __name__ == "__main__":
    main(*sys.argv[1:])
