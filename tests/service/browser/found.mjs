// What was found in the way by people who used the page.  See tests/service/test_workbench_found.py.
import { asked, axe, begun, bead, centre, current, drop, faded, newContext, number, open, part, sha, state, wide } from "./page.mjs";

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

// What is advised, before and after half-widths of one seat have other digits; a limit that nothing keeps, typed in the strip
scenarios.reach = async () => {
  const page = await begun(await newContext({ viewport: { width: 1280, height: 800 } })), next = page.getByRole("button", { name: /^Tighten/ }), found = { advice: [] };
  await next.waitFor();
  found.advice.push(await next.innerText());
  found.reach = await page.locator(".verdict .reach").innerText();
  const [x, y] = await centre(bead(page, "F2")), first = (await state(page)).score.targets[0].p95_mm;
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x - 30, y - 16, { steps: 3 });
  await page.mouse.up();
  await sha(page);
  found.moved = (await state(page)).score.targets[0].p95_mm - first;
  found.deltas = await page.locator(".budget tbody tr").evaluateAll((all) => all.map((row) => [row.querySelector("th").textContent, row.querySelector(".delta")?.className ?? "", row.querySelector(".delta")?.textContent ?? ""]));
  await page.keyboard.press("Control+z");
  await sha(page);
  await page.locator('[data-pointer="interfaces/connector_flange/tolerances/rx/half_width_deg"]').fill("0.1998");
  await page.keyboard.press("Enter");
  await sha(page);
  await next.waitFor();
  found.advice.push(await next.innerText());
  await page.keyboard.press("Control+z");
  await sha(page);
  const limit = page.getByLabel("limit of tip-accuracy, mm", { exact: true });
  await limit.fill("0.3");
  await limit.press("Enter");
  await sha(page);
  await page.locator(".wall").waitFor();
  found.wall = await page.locator(".wall").innerText();
  found.limit = (await state(page)).score.verdict.checks[0].limit;
  await strip(page).getByRole("button", { name: "Optimise this design" }).click();
  await page.locator(".wall", { hasText: "Out of reach" }).waitFor();
  found.out = [await page.locator(".wall").innerText(), await page.locator(".acts").innerText(), await next.count()];
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

// What each lever reaches, the search in the background with it; the curves under the sliders, and a limit that is pressed
scenarios.levers = async () => {
  const page = await begun(await newContext({ viewport: { width: asked.width ?? 1280, height: asked.height ?? 800 } })), bars = page.locator(".levers"), found = {};
  const rows = () => bars.locator("tbody tr").evaluateAll((all) => all.map((row) => [...row.cells].map((cell) => cell.textContent)));
  await page.getByRole("button", { name: /All \d+ levers/ }).click();
  await bars.locator("tr", { hasText: "by a search" }).waitFor();
  found.rows = await rows();
  found.keeps = await bars.locator("tr.keeps th").allTextContents();
  await page.getByRole("button", { name: "Curves" }).click();
  const at = page.locator('.slide:has([data-pointer="interfaces/connector_flange/tolerances/rx/half_width_deg"]) .crossing');
  await at.waitFor();
  found.crossing = Number(await at.getAttribute("data-at"));
  found.axe = await axe(page);
  await faded(page);
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: asked.width === 390 });
  await at.click();
  await sha(page);
  found.set = await page.locator('[data-pointer="interfaces/connector_flange/tolerances/rx/half_width_deg"]').inputValue();
  found.p95 = (await state(page)).score.targets[0].p95_mm;
  await page.keyboard.press("Control+z");
  await sha(page);
  found.wide = await wide(page);
  return found;
};

// What a drawing states of a seat is typed
scenarios.features = async () => {
  const page = await begun(await newContext());
  await part(page, "Views, pivots, targets, limits");
  for (const [feature, label, value] of asked.typed) {
    const field = page.locator("fieldset", { hasText: `: ${feature}` }).getByLabel(label, { exact: true });
    await field.fill(value);
    await field.press("Enter");
    await sha(page);
  }
  const { text, score } = await state(page);
  return { text, p95: score.targets[0].p95_mm, axe: await axe(page), wide: await wide(page) };
};

// A design without a requirement gets one under all fields, a second, and loses it; another gets one by the strip
scenarios.grow = async () => {
  const page = await begun(await newContext()), found = [], all = await part(page, "All fields"), fields = [];
  const look = async () => { await sha(page); found.push((await state(page)).score.verdict.checks.map(({ requirement, limit }) => [requirement, limit])); };
  await look();
  await all.getByLabel("Add a field to the design").selectOption("requirements");
  await look();
  await all.locator("summary", { hasText: "requirements" }).click();
  await all.getByRole("button", { name: "Add one more" }).first().click();
  await look();
  for (const k of [1, 0]) {
    await all.locator("details details > summary").nth(k).click();
    await all.getByLabel("limit_mm").first().waitFor();
    fields.push(await all.innerText());
    await all.getByRole("button", { name: `Remove requirements ${k}`, exact: true }).click();
  }
  await look();
  await all.getByRole("button", { name: "Add the first of requirements" }).click();
  await look();
  for (let k = 0; k < 6; k += 1) await page.keyboard.press("Control+z");
  await page.getByRole("button", { name: "State a limit" }).click();
  await look();
  return { found, fields };
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
  found.pressed = await enlarge.evaluate((node) => { const { color, backgroundColor } = getComputedStyle(node); return [color, backgroundColor]; }); // the pointer is over it
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

// Below a path: a report is made, its link leads to it, with a key it is fetched and saved, and what fails is said
scenarios.below = async () => {
  const page = await open(await newContext(), asked.url, false), key = page.getByLabel(/API key/);
  await drop(page, "design.yaml", asked.design);
  if (asked.key) {
    await key.fill(asked.key);
    await page.getByRole("button", { name: "Use it" }).click();
  }
  await current(page);
  await strip(page).getByRole("button", { name: "Report of this design" }).click();
  const link = strip(page).getByRole("link", { name: "Report" });
  await link.waitFor();
  const href = await link.evaluate((node) => node.href), found = { href };
  if (!asked.key) return { ...found, status: await page.evaluate(async (address) => { const answer = await fetch(address); return [answer.status, answer.headers.get("content-type"), answer.headers.get("content-disposition")]; }, href) };
  const [download] = await Promise.all([page.waitForEvent("download"), link.click()]);
  found.name = download.suggestedFilename();
  await page.route("**/report?format=html", (route) => route.fulfill({ status: 404, contentType: "application/problem+json", body: '{"title":"Not found","status":404,"errors":[]}' }));
  await link.click();
  await page.locator(".message.bad").waitFor();
  return { ...found, said: await page.locator(".message.bad").innerText() };
};

export default scenarios;
