// How the workbench leads: from points of one's own to a first design, to what to do next, and to a verified optimum.
// See tests/service/test_workbench_leads.py.
import { asked, axe, begun, bead, centre, current, drawn, drop, faded, newContext, open, part, sha, state, take, unhurried, wide } from "./page.mjs";

const scenarios = {};
const strip = (page) => page.locator("section.verdict");
const shot = async (page, name, more = {}) => { if (asked.shot) { await faded(page); await page.screenshot({ path: asked.shot.replace(/\.png$/, `_${name}.png`), ...more }); } };

// Files of points on a page without a design
scenarios.doors = async () => {
  const found = [];
  for (const { arm, ...file } of asked.files) {
    const page = await open(await newContext(), asked.url, false), arms = page.getByLabel("C-arm");
    await page.waitForFunction(() => document.querySelectorAll(".own option").length > 2);
    if (arm) await arms.selectOption(arm);
    const limit = page.getByLabel("95 % of all errors within, mm"), wrong = [];
    for (const typed of found.length ? [] : ["abc", "1e400", "1,500"]) {
      await limit.fill(typed);
      await drop(page, file.name, file.text);
      await page.locator(".message", { hasText: typed }).waitFor();
      wrong.push(await page.locator(".message").innerText(), (await state(page)).text);
    }
    await limit.fill("1,5");
    await drop(page, file.name, file.text);
    await current(page);
    const { text, score } = await state(page), words = await page.locator(".message").innerText();
    const rests = [await page.locator(".rests").innerText()];
    await page.locator(".rests").click();
    await page.locator(".assumed button", { hasText: "It is so" }).first().click(); // one value is stated,
    await current(page);
    rests.push(await page.locator(".rests").innerText());
    await page.keyboard.press("Control+z"); // and is not
    await current(page);
    rests.push(await page.locator(".rests").innerText());
    found.push({ text, status: score.verdict.status, words, rests, arms: arm, wrong });
    await page.close();
  }
  return { found };
};

// From a list of beads to a verified optimum and its report, by what the strip offers: with a finger on a phone, or
// with nothing but keys
scenarios.job = async () => {
  const touch = asked.by === "touch", phone = { hasTouch: true, isMobile: true, viewport: { width: 390, height: 844 } }, found = { seen: [], stops: {} };
  const context = await newContext(touch ? phone : {}), page = await open(context, asked.url, false);
  const reach = async (locator, key) => {
    for (let k = 1; k <= 40; k += 1) {
      await page.keyboard.press(key);
      if (await locator.evaluate((node) => node === document.activeElement)) return k;
    }
    throw new Error(`${key} does not reach ${locator}`);
  };
  const press = async (locator, way = "Tab") => {
    if (touch) return locator.tap();
    found.stops[await locator.evaluate((node) => node.ariaLabel ?? node.innerText ?? "")] = await reach(locator, way);
    await page.keyboard.press("Enter");
  };
  await page.waitForFunction(() => document.querySelectorAll(".gallery li").length > 1);
  await shot(page, "start");
  found.start = [await axe(page), await wide(page)];
  const file = page.locator(".own input[type=file]"), chosen = page.waitForEvent("filechooser");
  await press(touch ? page.locator(".own label.button") : file);
  await (await chosen).setFiles({ name: asked.file.name, mimeType: "text/csv", buffer: Buffer.from(asked.file.text) });
  await current(page);
  await shot(page, "first");
  found.first = { sha: await sha(page), badge: await strip(page).locator(".badge").innerText() };
  await press(strip(page).getByRole("button", { name: "Optimise this design" }));
  const take = strip(page).getByRole("button", { name: /^Take the optimum/ });
  await take.waitFor();
  found.seen.push(await take.innerText());
  await shot(page, "optimum");
  await press(take);
  found.taken = await sha(page);
  await page.locator('section.verdict[data-basis="simulation"]').waitFor(); // an optimum comes with its verification
  await press(strip(page).getByRole("button", { name: "Report of this design" }), "Shift+Tab");
  const report = strip(page).getByRole("link", { name: "Report" });
  await report.waitFor();
  await shot(page, "verified");
  found.last = { sha: await sha(page), badge: await strip(page).locator(".badge").innerText(), axe: await axe(page), wide: await wide(page) };
  await page.emulateMedia({ colorScheme: "dark" });
  found.last.axe.push(...(await axe(page)));
  const tab = context.waitForEvent("page");
  await press(report);
  await (await tab).waitForLoadState();
  found.title = await (await tab).title();
  return found;
};

// A bead is dragged: where it was, and by how much the numbers change; then what the strip offers for a design that fails
scenarios.next = async () => {
  const page = await begun(await unhurried()), found = {}, numbers = async () => (await page.locator('[data-testid="numbers"] dd').first().innerText()).replace(/\s+/g, " ");
  const first = await sha(page), [x, y] = await centre(bead(page, "F2"));
  const look = async () => ({ numbers: await numbers(), value: (await state(page)).score.verdict.checks[0].value, outlines: await page.locator(".picture .was circle").count(), deltas: await page.locator(".budget .delta").count(), states: await page.locator(".trail .state").count() });
  found.begin = await look();
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 24, y + 12, { steps: 4 });
  await page.locator(".numbers .delta").waitFor();
  await current(page);
  found.held = await look();
  await shot(page, "held");
  await page.mouse.up();
  await sha(page);
  await page.locator(".trail").waitFor();
  found.dropped = await look();
  await page.locator('.trail .state[data-step="0"]').click();
  found.back = (await sha(page)) === first;
  const next = page.getByRole("button", { name: /^Tighten/ });
  await next.waitFor();
  found.advice = await next.innerText();
  await shot(page, "next");
  await next.click();
  await sha(page);
  const { text, score } = await state(page);
  return { ...found, text, status: score.verdict.status, value: score.verdict.checks[0].value };
};

// An optimisation of a design that says nothing of one; a report of what is on the page
scenarios.unasked = async () => {
  const page = await begun(await newContext()), before = (await state(page)).text;
  const optimise = strip(page).getByRole("button", { name: "Optimise this design" });
  const title = await optimise.getAttribute("title");
  await optimise.click();
  const take = strip(page).getByRole("button", { name: /^Take the optimum/ });
  await take.waitFor();
  const unchanged = (await state(page)).text === before;
  await take.click();
  await sha(page);
  const { text, score } = await state(page);
  await strip(page).getByRole("button", { name: "Report of this design" }).click();
  await strip(page).getByRole("link", { name: "Report" }).waitFor();
  return { title, unchanged, text, p95: score.targets[0].p95_mm };
};

// How many presses of Tab from the top of the page to the strip's buttons, with steps to undo and to redo
scenarios.tabs = async () => {
  const page = await begun(await newContext());
  for (const value of ["27", "26"]) {
    await page.getByLabel("F2 x, mm", { exact: true }).fill(value);
    await page.keyboard.press("Enter");
    await sha(page);
  }
  await page.keyboard.press("Control+z");
  await sha(page);
  await page.evaluate(() => { document.body.tabIndex = -1; document.body.focus(); document.body.removeAttribute("tabindex"); });
  const stops = [];
  for (let k = 0; k < 12; k += 1) {
    await page.keyboard.press("Tab");
    stops.push(await page.evaluate(() => { const at = document.activeElement; return at.getAttribute("aria-label") ?? at.closest("label")?.innerText ?? at.innerText; }));
  }
  return { stops };
};

// The drill guide shows itself: step by step, over a reload, to its end, and not again
scenarios.minute = async () => {
  const page = await open(await newContext({ viewport: { width: 1280, height: 800 } }), asked.url, false), note = page.getByRole("note", { name: "The first minute" }), words = [];
  const choose = (name) => page.getByRole("button", { name }).click();
  await choose(asked.example);
  words.push(await note.innerText());
  await current(page);
  const ringed = await page.locator("g.bead:has(.hint)").evaluateAll((all) => all.map((one) => one.dataset.bead));
  await faded(page);
  const found = { ringed, axe: await axe(page), wide: await wide(page) };
  await shot(page, "first");
  const [x, y] = await centre(bead(page, ringed[0], "Side (y, z)"));
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 20, y + 12, { steps: 4 });
  await page.mouse.up();
  await note.filter({ hasText: "2 of 3" }).waitFor();
  words.push(await note.innerText());
  await page.reload();
  await current(page);
  words.push(await note.innerText());
  const limit = strip(page).getByLabel(/^limit of /);
  await limit.fill("0.3");
  await limit.press("Enter");
  await note.filter({ hasText: "no tightening keeps this limit" }).waitFor();
  found.offered = await strip(page).getByRole("button", { name: /^Tighten/ }).count();
  await limit.fill("1");
  await limit.press("Enter");
  await strip(page).getByRole("button", { name: /^Tighten/ }).click();
  await note.filter({ hasText: "3 of 3" }).waitFor();
  words.push(await note.innerText());
  await strip(page).getByRole("button", { name: "Verify this design" }).click();
  await page.locator('section.verdict[data-basis="simulation"]').waitFor();
  await drawn(page);
  found.ended = await note.count();
  await part(page, "Other designs");
  await choose("my first carrier");
  await current(page);
  await choose(asked.example);
  await current(page);
  return { ...found, words, again: await note.count() };
};

// The numbers of several designs, as they are written
scenarios.digits = async () => {
  const page = await open(await newContext(), asked.url, false), found = [];
  for (const design of asked.designs) {
    await take(page, design);
    await page.waitForFunction((text) => window.workbench.state().text === text, design);
    await sha(page);
    const rows = page.getByRole("region", { name: "Table of requirements" }).locator("tbody tr").first().locator("td.number");
    found.push({
      p95: await page.locator("#p95").textContent(), mean: (await page.locator(".numbers div", { hasText: "Mean error" }).locator("dd").textContent()).split(" ")[0],
      row: await rows.allInnerTexts(), without: await page.getByRole("region", { name: "Table of the budget" }).locator("tbody tr").first().locator("td.number").last().allInnerTexts(),
    });
  }
  return { found };
};

// What the words mean, and an answer that the page does not understand
scenarios.words = async () => {
  const page = await begun(await newContext()), tip = page.locator("#tip"), found = {};
  await page.locator(".verdict .term", { hasText: "P95" }).first().hover();
  found.hovered = await tip.innerText();
  await page.locator(".budget thead .term", { hasText: "Half-width" }).focus();
  await tip.filter({ hasText: "half-width" }).waitFor();
  found.focused = await tip.innerText();
  await shot(page, "tip");
  await page.keyboard.press("Escape");
  await drawn(page);
  found.left = await tip.count();
  await page.keyboard.press("?");
  await page.locator("dialog.words dl").waitFor();
  found.list = await page.locator("dialog.words").innerText();
  found.axe = await axe(page);
  await shot(page, "list");
  await page.keyboard.press("Escape");
  const manual = page.getByRole("dialog", { name: "The manual" }), heading = (name) => manual.getByRole("heading", { name, level: 1 }).waitFor();
  await page.getByRole("button", { name: "The manual" }).click();
  await heading("The workbench");
  await manual.getByRole("link", { name: "STEP file" }).click();
  await heading("STEP");
  found.manual = await axe(page);
  await shot(page, "manual");
  await manual.getByRole("button", { name: "All pages" }).click();
  await heading("All pages");
  found.pages = await manual.getByRole("link").evaluateAll((links) => links.map((link) => link.href));
  await manual.getByRole("button", { name: "Back" }).click();
  await heading("STEP");
  await page.keyboard.press("Escape");
  found.closed = await manual.count();
  await page.route("**/v1/scores", async (route) => {
    const response = await route.fetch(), score = await response.json();
    await route.fulfill({ response, json: { ...score, schema: "tailstack/score/2", verdict: { status: "pass" } } });
  });
  await page.getByLabel("F2 x, mm", { exact: true }).fill("27.25");
  await page.keyboard.press("Enter");
  await page.locator(".verdict.refused").waitFor();
  found.strip = await strip(page).innerText();
  return found;
};

// How much there is to scroll, with what is opened by itself; one kind of pictures alone, and how wide they are
scenarios.screen = async () => {
  const page = await begun(await newContext({ viewport: { width: 1280, height: 800 } }));
  await page.locator(".space canvas").first().waitFor();
  await faded(page);
  const ends = await page.locator(".panes section").evaluateAll((all) => all.map((one) => Math.round(one.getBoundingClientRect().bottom)));
  await shot(page, "top");
  const windows = (all) => all.map((one) => one.scrollHeight / one.clientHeight), splitter = page.getByRole("separator");
  const found = { scrolls: await page.evaluate(() => document.documentElement.scrollHeight > innerHeight), windows: await page.locator(".see, .change").evaluateAll(windows), ends, wide: await wide(page), axe: await axe(page) };
  const look = async () => ({ panes: await page.locator(".panes section").evaluateAll((all) => all.map((one) => one.ariaLabel)), split: Number(await splitter.getAttribute("aria-valuenow")), width: Math.round((await page.locator(".see").boundingBox()).width) });
  found.panes = [await look()];
  await page.getByRole("group", { name: "Pictures" }).getByRole("button", { name: "In space" }).click();
  await splitter.focus();
  for (let k = 0; k < 3; k += 1) await page.keyboard.press("ArrowLeft");
  found.panes.push(await look());
  const [x, y] = await centre(splitter);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 200, y, { steps: 3 });
  await page.mouse.up();
  found.panes.push(await look());
  await page.reload();
  await page.locator(".space canvas").first().waitFor();
  found.panes.push(await look());
  const half = await begun(await newContext({ viewport: { width: 640, height: 400 } })); // as 1280 x 800 at 200 %
  await half.evaluate(() => scrollTo(0, 1200));
  await faded(half);
  found.zoomed = { top: (await half.locator(".verdict .head").boundingBox()).y, height: (await half.locator(".verdict .head").boundingBox()).height, wide: await wide(half), axe: await axe(half) };
  await shot(half, "half");
  await half.emulateMedia({ colorScheme: "dark" });
  found.zoomed.axe.push(...(await axe(half)));
  return found;
};

export default scenarios;
