// What was found in the way by people who used the page.  See tests/service/test_workbench_found.py.
import { asked, begun, current, drop, faded, newContext, open, wide } from "./page.mjs";

const scenarios = {};
const strip = (page) => page.locator("section.verdict");
const numbers = async (page) => Object.fromEntries(await page.locator('[data-testid="numbers"] > div').evaluateAll((all) => all.map((one) => [one.querySelector("dt").textContent.split(" of the")[0], one.querySelector("dd").textContent])));

// A simulation that refutes its estimate
scenarios.refuted = async () => {
  const page = await begun(await newContext()), found = { estimate: await strip(page).innerText() };
  await strip(page).getByRole("button", { name: "Verify this design" }).click();
  await page.locator('section.verdict[data-basis="simulation"]').waitFor();
  await faded(page);
  const budget = page.locator(".budget");
  found.numbers = await numbers(page);
  found.words = await strip(page).innerText();
  found.outdated = await budget.evaluate((node) => node.classList.contains("outdated"));
  found.shares = await budget.locator(".number").last().evaluate((node) => getComputedStyle(node).opacity);
  found.advice = await page.locator(".next").count();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

// Pictures at 1280 x 800: the size of their words, and what Enlarge does; a phone after a card far below was pressed
scenarios.sizes = async () => {
  const page = await begun(await newContext({ viewport: { width: 1280, height: 800 } })), found = {};
  const measure = () => page.locator("figure.picture").first().evaluate((figure) => {
    const svg = figure.querySelector("svg"), scale = svg.getScreenCTM().a, marks = [...svg.querySelectorAll(".mark")].map((mark) => mark.getBoundingClientRect().x);
    return { width: svg.clientWidth, spread: Math.max(...marks) - Math.min(...marks), words: Math.min(...[...document.querySelectorAll(".picture text")].map((text) => Number(text.getAttribute("font-size")) * text.closest("svg").getScreenCTM().a)), scale };
  });
  await faded(page);
  found.before = await measure();
  const enlarge = page.getByRole("button", { name: "Enlarge" }).first();
  await enlarge.click();
  await faded(page);
  found.after = await measure();
  found.pressed = await page.getByRole("button", { name: "Whole image" }).evaluate((node) => { const { color, backgroundColor } = getComputedStyle(node); return [color, backgroundColor]; }); // the pointer is over it
  if (asked.shot) await page.screenshot({ path: asked.shot });
  const phone = await open(await newContext({ hasTouch: true, isMobile: true, viewport: { width: 390, height: 844 } }), asked.url, false);
  await phone.locator(".gallery button").last().tap();
  await current(phone);
  await faded(phone);
  const box = await strip(phone).locator(".head").boundingBox();
  found.phone = { scrolled: await phone.evaluate(() => scrollY), top: box.y, wide: await wide(phone) };
  return found;
};

// Beads as people have them: a table without a header, one between spaces, a workbook
scenarios.tables = async () => {
  const found = [];
  for (const { name, base64, press } of asked.files) {
    const page = await open(await newContext(), asked.url, false);
    await drop(page, name, Buffer.from(base64, "base64"));
    if (press) {
      await page.getByRole("button", { name: press }).click();
      await current(page);
    }
    await page.locator(".message", { hasText: name }).waitFor();
    found.push({ words: await page.locator(".message").innerText(), beads: await page.locator(".beads tbody tr").evaluateAll((rows) => rows.map((row) => [row.querySelector("th").textContent, ...[...row.querySelectorAll("input")].map((field) => Number(field.value))])) });
    await page.close();
  }
  return { found };
};

export default scenarios;
