// What the workbench shows, and how it answers: one scenario of those below.  See tests/service/test_workbench_shown.py.
import { asked, axe, begun, bead, centre, current, downloaded, drawn, faded, newContext, number, open, part, sha, state, take, wide } from "./page.mjs";

const scenarios = {};
const strip = (page) => page.locator("section.verdict");
const opacity = (locator) => locator.evaluate((node) => { let all = 1; for (let at = node; at; at = at.parentElement) all *= Number(getComputedStyle(at).opacity); return all; });
const picture = (page, name) => page.locator("figure.picture", { has: page.locator("figcaption", { hasText: name }) });
const press = async (page, [x, y]) => { await page.mouse.move(x, y); await page.mouse.down(); await page.mouse.up(); };
const awaitRun = (page, kind) => page.locator(`.run[data-kind=${kind}][data-state=succeeded]`).first().waitFor();

// A press at the centre of every mark of every picture: which bead was announced, which was taken
scenarios.press = async () => {
  const page = await begun(await newContext()), found = [], pictures = page.locator("figure.picture");
  await page.locator(".message").getByRole("button").click();
  const before = (await state(page)).steps;
  for (let k = 0; k < (await pictures.count()); k += 1) {
    const name = (await pictures.nth(k).locator("figcaption").textContent()).split(":")[0];
    const labels = await pictures.nth(k).locator("g.bead").evaluateAll((all) => all.map((one) => one.dataset.bead));
    for (const label of labels.sort()) {
      const [x, y] = await centre(pictures.nth(k).locator(`g.bead[data-bead="${label}"] circle.mark`));
      await page.mouse.move(x, y);
      const announced = await pictures.nth(k).locator("g.bead.over").getAttribute("data-bead");
      await page.mouse.down();
      const taken = await pictures.nth(k).locator("g.bead.chosen").getAttribute("data-bead");
      await page.mouse.up();
      found.push([name, label, announced, taken]);
    }
  }
  return { found, steps: (await state(page)).steps - before };
};

// Two beads at one place of a picture: pressed again and again without moving, and then dragged
scenarios.below = async () => {
  const page = await begun(await newContext()), front = picture(page, "Front (x, z)"), chosen = [];
  const at = await centre(front.locator(`g.bead[data-bead="${asked.labels[0]}"] circle.mark`));
  const now = () => front.locator("g.bead.chosen").getAttribute("data-bead");
  for (let k = 0; k < 3; k += 1) {
    await press(page, at);
    chosen.push(await now());
  }
  const said = await front.locator("svg > title").textContent();
  await page.mouse.down();
  await page.mouse.move(at[0] + 30, at[1], { steps: 3 });
  await page.mouse.up();
  return { chosen, said, moved: await page.locator(".history button").first().getAttribute("aria-label") };
};

// A finger: a swipe over a bead scrolls the page; the bead that was chosen before is dragged
scenarios.finger = async () => {
  const page = await begun(await newContext({ hasTouch: true, isMobile: true, viewport: { width: 390, height: 800 } }));
  const session = await page.context().newCDPSession(page), mark = bead(page, "F9");
  await mark.evaluate((node) => node.scrollIntoView({ block: "center" }));
  const swipe = async (moved) => {
    const box = await mark.boundingBox(), x = box.x + box.width / 2, y = box.y + box.height / 2, steps = (await state(page)).steps, top = await page.evaluate(() => scrollY);
    const touch = (type, by) => session.send("Input.dispatchTouchEvent", { type, touchPoints: type === "touchEnd" ? [] : [{ x, y: y - by }] });
    await touch("touchStart", 0);
    for (let by = 4; by <= 120; by += 4) await touch("touchMove", by);
    await touch("touchEnd", 0);
    await page.waitForFunction(moved, [top, steps]);
    await drawn(page);
    return { scrolled: Math.round((await page.evaluate(() => scrollY)) - top), steps: (await state(page)).steps - steps };
  };
  const first = await swipe(([top]) => scrollY > top + 50);
  await mark.evaluate((node) => node.scrollIntoView({ block: "center" }));
  const box = await mark.boundingBox();
  await page.touchscreen.tap(box.x + box.width / 2, box.y + box.height / 2);
  const chosen = await picture(page, "Front (x, z)").locator("g.bead.chosen").getAttribute("data-bead");
  return { first, chosen, second: await swipe(([, steps]) => window.workbench.state().steps > steps) };
};

// The strip before and after a verification that is asked for in the strip; what a change and a reload make of it
scenarios.verified = async () => {
  const page = await begun(await newContext()), look = async () => ({ basis: await strip(page).getAttribute("data-basis"), words: await strip(page).innerText() });
  const inside = await strip(page).getByRole("button", { name: "Verify this design" }).boundingBox();
  const before = await look();
  await strip(page).getByRole("button", { name: "Verify this design" }).click();
  await page.locator('section.verdict[data-basis="simulation"]').waitFor();
  const after = await look(), run = await page.locator(".run[data-kind=report] .status").first().innerText(), rows = await page.getByRole("region", { name: "Table of requirements" }).innerText();
  const offered = await strip(page).getByRole("button", { name: "Verify this design" }).count();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await number(page, "F1 x, mm", "-31");
  await current(page);
  const changed = await look();
  await page.keyboard.press("Control+z");
  await current(page);
  const undone = await look();
  await page.reload();
  await current(page);
  await page.locator('section.verdict[data-basis="simulation"]').waitFor();
  return { inside, before, after, run, rows, offered, changed, undone };
};

// An optimum that is taken ends with the verdict of its own verification
scenarios.optimum = async () => {
  const page = await begun(await newContext());
  await strip(page).getByRole("button", { name: "Optimise this design" }).click();
  await awaitRun(page, "optimisation");
  const taking = page.getByRole("button", { name: /Take this design/ });
  await taking.waitFor(); // with its result, which comes after the word that it is done
  const notes = await page.locator(".run .note").allInnerTexts();
  await taking.click();
  await current(page);
  return { notes, basis: await strip(page).getAttribute("data-basis"), badge: await page.locator(".badge").innerText(), words: await strip(page).innerText() };
};

// A requirement on each unit beside a pooled one: strip, run, slack and versions say the same
scenarios.units = async () => {
  const page = await begun(await newContext()), p95 = await page.locator("#p95").textContent();
  await part(page, "Versions");
  await page.getByRole("button", { name: "Keep this design as a version" }).click();
  const versions = await page.locator('[aria-label="Versions"] tbody tr').allInnerTexts();
  await page.getByRole("button", { name: "How far may each be loosened?" }).click();
  const opened = await page.locator("details.part", { has: page.getByRole("heading", { name: "Run", exact: true }) }).evaluate((node) => new Promise((done) => { const look = () => (node.open ? done(true) : requestAnimationFrame(look)); look(); }));
  const said = await page.locator(".budget .note", { hasText: "Slack:" }).innerText(), slack = await page.locator(".budget .slack").allInnerTexts();
  await strip(page).getByRole("button", { name: "Verify this design" }).click();
  await page.locator('section.verdict[data-basis="simulation"]').waitFor();
  await page.locator(".run .histogram").first().waitFor();
  const listed = await page.getByRole("region", { name: "Requirements as verified" }).first().locator("tbody tr").allInnerTexts();
  const rows = await page.getByRole("region", { name: "Table of requirements" }).locator("tbody tr").allInnerTexts();
  const head = await page.locator(".run").first().locator(".head").innerText();
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
  return { p95, versions, opened, said, slack, listed, rows, head, verified: await page.locator("#p95").textContent(), caption: await page.locator(".histogram figcaption").first().textContent() };
};

// The tables of the report below the list, before and after a change
scenarios.figures = async () => {
  const page = await begun(await newContext()), figures = page.locator(".figures:not(.outdated)");
  await page.getByText("Every figure of the budget").click();
  const read = async () => {
    const table = figures.locator("table").first();
    await table.waitFor();
    return { caption: await table.locator("caption").innerText(), heads: await table.locator("thead th").allInnerTexts(), rows: await table.locator("tbody tr").allInnerTexts() };
  };
  const before = await read();
  if (asked.shot) {
    await page.locator(".figures").scrollIntoViewIfNeeded();
    await page.screenshot({ path: asked.shot });
  }
  await number(page, "F1 x, mm", "-31");
  await current(page);
  return { before, after: await read(), p95: await page.locator("#p95").textContent() };
};

// While a newer score is awaited, or refused, nothing of an older design is in full colour
scenarios.grey = async () => {
  const context = await newContext(), page = await begun(context), found = {}, release = [];
  const holding = { on: false };
  await page.route("**/v1/scores", async (route) => {
    if (holding.on) await new Promise((done) => release.push(done));
    await route.continue();
  });
  const shades = async () => ({
    sentence: await opacity(strip(page).locator(".sentence .stated")), p95: await opacity(page.locator("#p95")), badge: await opacity(page.locator(".badge")), word: await page.locator(".badge").innerText(),
    colours: await strip(page).getAttribute("class"), budget: await opacity(page.locator(".budget .blame")), rows: await opacity(page.locator("table.checks td").first()),
    picture: await opacity(picture(page, "AP").locator("svg")),
  });
  found.current = await shades();
  const [x, y] = await centre(bead(page, "F9"));
  holding.on = true;
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 9, y, { steps: 3 });
  await page.locator(".numbers.old").waitFor();
  found.awaited = await shades();
  holding.on = false;
  for (const done of release) done();
  await page.mouse.up();
  await current(page);
  found.answered = await shades();
  await strip(page).getByRole("button", { name: "Verify this design" }).click();
  await awaitRun(page, "report");
  await page.locator(".run .checks").waitFor();
  found.own = await opacity(page.locator(".run .checks td").first());
  await number(page, "F1 x, mm", "-31");
  await current(page);
  await page.locator(".run.other").waitFor();
  found.other = await opacity(page.locator(".run .checks td").first());
  await part(page, "Views, pivots, targets, limits");
  await page.locator('[data-pointer="views/0/source_isocentre_mm"]').first().fill("-5");
  await page.keyboard.press("Enter");
  await page.locator(".verdict.refused").waitFor();
  await faded(page);
  found.refused = { pictures: await Promise.all((await page.locator('[aria-label="X-ray images"] figure.picture svg').all()).map(opacity)), p95: await opacity(page.locator("#p95")), text: await page.locator("#page").innerText() };
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

// Where there is no score, no requirement is denied; where none is stated, it is said
scenarios.none = async () => {
  const found = {}, refused = await open(await newContext(), asked.url, false);
  await take(refused, asked.refused);
  await refused.locator(".verdict.refused").waitFor();
  found.refused = await refused.locator("#page").innerText();
  const waiting = await open(await newContext(), asked.url, false);
  await waiting.route("**/v1/scores", () => {}); // never answered
  await waiting.route("**/health/ready", (route) => route.fulfill({ status: 503, json: { status: "warming up", kernels: "warming up", database: "ready", workers: 1 } }));
  await take(waiting, asked.design);
  await waiting.locator(".badge", { hasText: "Warming up" }).waitFor();
  found.waiting = await waiting.locator("#page").innerText();
  const without = await open(await newContext(), asked.url, false);
  await take(without, asked.without);
  await current(without);
  found.without = await without.locator("#page").innerText();
  return found;
};

// What is answered far down the page is answered there, and moves nothing
scenarios.near = async () => {
  const context = await newContext(), page = await begun(context), found = {};
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await page.locator(".message").getByRole("button").click();
  await part(page, "Share and save");
  const button = page.getByRole("button", { name: "Copy as curl" });
  await button.scrollIntoViewIfNeeded();
  const before = await button.boundingBox();
  await button.click();
  await page.locator(".message").waitFor();
  const box = await page.locator(".message").boundingBox(), after = await button.boundingBox();
  found.inside = box.y >= 0 && box.y + box.height <= page.viewportSize().height;
  found.shifted = after.y - before.y;
  let answer;
  await page.route("**/v1/conversions*", async (route) => { await new Promise((done) => { answer = done; }); await route.continue(); });
  await page.setInputFiles("header input[type=file]", { name: asked.file, mimeType: "application/step", buffer: Buffer.from(asked.step) });
  await page.locator(".working progress").waitFor();
  found.working = await page.locator(".working").innerText();
  answer();
  await page.locator(".message", { hasText: asked.file }).waitFor();
  found.done = await page.locator(".working").count();
  return found;
};

// Numbers as people type them, and what is none
scenarios.numbers = async () => {
  const page = await begun(await newContext()), field = page.getByLabel("F2 x, mm", { exact: true }), found = {};
  for (const typed of ["27,5", "28 mm", "29mm", "−3.5", "abc", "0x10", "12 px", "1e2"]) {
    await field.fill(typed);
    await field.press("Enter");
    const value = await page.evaluate(() => /F2, position_mm: \[ ?([^,]+),/.exec(window.workbench.state().text)[1]);
    found[typed] = { value, shown: await field.inputValue(), wrong: await page.locator(".wrong").allInnerTexts(), invalid: await field.getAttribute("aria-invalid") };
    if (found[typed].wrong.length) await page.keyboard.press("Escape");
  }
  await number(page, "F2 x, mm", "30");
  await part(page, "Run");
  await page.locator("summary", { hasText: "Sweep one number" }).click();
  await page.getByLabel("Number", { exact: true }).selectOption(asked.axis);
  const offered = await page.getByLabel("Number", { exact: true }).locator("option").allInnerTexts();
  await page.getByLabel("from", { exact: true }).fill("zero");
  await page.getByRole("button", { name: "Sweep", exact: true }).click();
  const refused = await page.getByLabel("from", { exact: true }).evaluate((node) => node.validationMessage);
  for (const [label, value] of [["from", "0,2"], ["to", "0.4"], ["points", "3"]]) await page.getByLabel(label, { exact: true }).fill(value);
  await page.getByRole("button", { name: "Sweep", exact: true }).click();
  await awaitRun(page, "sweep");
  await page.locator(".run[data-kind=sweep] tbody tr").first().waitFor();
  const head = await page.locator(".run[data-kind=sweep] thead th").first().innerText();
  return { found, refused, offered, head, sweep: await page.locator(".run[data-kind=sweep] tbody tr > th").allInnerTexts() };
};

// A number that is swept: its plot and its table; one of its points is taken, by keys or by a press on it
scenarios.sweep = async () => {
  const page = await begun(await newContext()), found = {};
  await part(page, "Run");
  await page.locator("summary", { hasText: "Sweep one number" }).click();
  await page.getByLabel("Number", { exact: true }).selectOption({ label: asked.axis });
  found.offered = await Promise.all(["from", "to"].map((label) => page.getByLabel(label, { exact: true }).inputValue()));
  await page.getByLabel("points", { exact: true }).fill("7");
  await page.getByRole("button", { name: "Sweep", exact: true }).click();
  const plot = page.locator(".plot svg"), rows = page.locator(".swept tbody tr");
  await plot.waitFor();
  const numbers = (locator, names) => locator.evaluateAll((all, wanted) => all.map((one) => wanted.map((name) => Number(one.getAttribute(name)))), names);
  found.points = await Promise.all((await plot.locator(".line").all()).map((line) => numbers(line.locator("circle:last-child"), ["cx", "cy"])));
  found.limits = await plot.locator(".limit path").evaluateAll((all) => all.map((one) => Number(/ ([\d.]+)H/.exec(one.getAttribute("d"))[1])));
  found.now = await plot.locator(".now path").evaluateAll((all) => all.map((one) => Number(/M([\d.]+) /.exec(one.getAttribute("d"))[1])));
  found.words = await plot.getAttribute("aria-label");
  found.head = await page.locator(".swept thead th").allInnerTexts();
  found.rows = await rows.evaluateAll((all) => all.map((row) => [...row.cells].slice(0, -1).map((cell) => cell.textContent)));
  await faded(page);
  found.axe = await axe(page);
  found.rings = await plot.locator(".fails").count();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await rows.nth(1).getByRole("button").focus();
  await page.keyboard.press("Enter");
  found.keys = { sha: await sha(page), text: (await state(page)).text, now: await rows.nth(1).innerText() };
  await plot.locator(".free").nth(2).click();
  found.pressed = { sha: await sha(page), text: (await state(page)).text };
  found.old = await page.locator(".swept").evaluate((node) => node.closest(".old") !== null);
  await number(page, "F2 x, mm", "31");
  await page.locator(".old .swept").waitFor();
  found.steps = (await state(page)).position;
  return found;
};

// A diagnostic of every kind in the editor, pointed at: nothing that the policy of the page forbids.  And Tab leaves it
scenarios.editor = async () => {
  const context = await newContext();
  await context.addInitScript(() => {
    window.breaches = [];
    document.addEventListener("securitypolicyviolation", (event) => window.breaches.push(`${event.violatedDirective} ${event.blockedURI}`));
  });
  const page = await begun(context), seen = {}, text = page.locator(".editor .cm-content");
  await part(page, "As text");
  await text.waitFor();
  const type = async (what) => {
    await text.click();
    await page.keyboard.press("Control+a");
    await page.keyboard.insertText(what);
    await page.locator(".editor .cm-lint-marker-error").first().waitFor();
  };
  const point = async (name) => {
    await page.mouse.move(5, 5);
    const box = await page.locator(`.editor ${name}`).first().boundingBox();
    await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2, { steps: 3 });
    await page.locator(".editor .cm-tooltip .cm-diagnostic").first().waitFor();
  };
  for (const [name, source] of Object.entries(asked.texts)) {
    await type(source);
    await page.locator(".editor").scrollIntoViewIfNeeded();
    const marks = page.locator(".editor .cm-lintRange, .editor .cm-lintPoint");
    await marks.first().scrollIntoViewIfNeeded();
    await point(".cm-lint-marker-error");
    seen[name] = await page.locator(".editor .cm-diagnostic").first().innerText();
    if (await page.locator(".editor .cm-lintRange").count()) await point(".cm-lintRange");
  }
  await text.click();
  const before = (await state(page)).text;
  await page.keyboard.press("Tab");
  await page.keyboard.press("Tab");
  const left = await page.evaluate(() => !document.activeElement?.matches(".editor"));
  return { seen, breaches: await page.evaluate(() => window.breaches), left, same: (await state(page)).text === before, hint: await page.locator("details.part", { has: page.locator(".editor") }).innerText() };
};

// The service goes away and comes back: the score is asked for when it does, not when the page would have tried again
scenarios.back = async () => {
  const page = await open(await newContext(), asked.url, false);
  await page.clock.install();
  await take(page, asked.design);
  await page.clock.runFor(1000);
  await current(page);
  await page.clock.pauseAt((await page.evaluate(() => Date.now())) + 60_000); // from here on it goes as far as it is sent, and not by itself
  await strip(page).getByRole("button", { name: /^Tighten/ }).waitFor(); // the last thing that is asked for by itself: nothing is on the way
  await page.evaluate(() => { // a service that is away: every request fails at once, with nothing on the way
    const fetch = window.fetch;
    Object.assign(window, { asks: [], back: () => { window.fetch = fetch; } });
    window.fetch = (address) => {
      if (String(address).endsWith("/v1/scores")) window.asks.push(Date.now());
      return Promise.reject(new TypeError("away"));
    };
  });
  await number(page, "F1 x, mm", "-31");
  await page.getByText("The service does not answer").first().waitFor();
  for (let k = 0; k < 20; k += 1) await page.clock.runFor(500);
  const asks = await page.evaluate(() => { window.back(); return window.asks; });
  await page.clock.runFor(2100); // the next look at its health
  await page.waitForFunction(() => window.workbench.state().current, null, { polling: 100 });
  return { waited: asks.slice(1).map((at, k) => at - asks[k]), current: (await state(page)).current };
};

// Keys in either case, where the focus is after a choice, regions that are told apart, and the widest table
scenarios.marks = async () => {
  const page = await open(await newContext(), asked.url, false), found = {};
  await page.getByRole("button", { name: asked.example }).focus();
  await page.keyboard.press("Enter");
  await current(page);
  found.focus = await page.evaluate(() => document.activeElement?.id);
  await page.getByRole("application", { name: /^Elevation Front/ }).focus();
  const chosen = () => page.locator("tr.chosen th").first().innerText();
  await page.keyboard.press("Shift+N");
  const first = await chosen();
  await page.keyboard.press("Shift+N");
  found.keys = [first, await chosen()];
  await page.keyboard.press("Shift+P");
  found.keys.push(await chosen());
  const names = await page.locator("section[aria-label], [role=region][aria-label]").evaluateAll((all) => all.map((one) => one.getAttribute("aria-label")));
  found.twice = names.filter((name, k) => names.indexOf(name) !== k);
  await page.getByRole("button", { name: "How far may each be loosened?" }).click();
  await page.getByRole("columnheader", { name: "slack" }).waitFor();
  found.cut = await page.getByRole("region", { name: "Table of the budget" }).evaluate((node) => node.scrollWidth - node.clientWidth);
  const licences = page.getByRole("link", { name: "Licences", exact: true });
  found.licences = await (await page.request.get(await licences.evaluate((node) => node.href))).text();
  found.wide = await wide(page);
  return found;
};

// Many targets: how much of the window the strip takes
scenarios.tall = async () => {
  const page = await begun(await newContext());
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return { height: (await strip(page).boundingBox()).height, words: await strip(page).innerText(), sha: await sha(page) };
};

// On a phone: what stays in sight while the page is scrolled, and whether the page is wider than the phone
scenarios.phone = async () => {
  const page = await begun(await newContext({ hasTouch: true, isMobile: true, viewport: { width: 390, height: 844 } }));
  const said = await page.locator(".verdict .stated").innerText(), value = await page.locator("#p95").textContent();
  await page.evaluate(() => scrollTo(0, 2500));
  await faded(page);
  const head = page.locator(".verdict .head"), box = await head.boundingBox();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return { said, value, words: await head.innerText(), top: box.y, height: box.height, wide: await wide(page) };
};

// From a design to the first page and on again: by its button, by the browser's, by keys, by what is opened there
scenarios.doors = async () => {
  const page = await begun(await newContext()), found = {}, text = async () => (await state(page)).text, focus = () => page.evaluate(() => document.activeElement.id);
  const look = async () => { await drawn(page); return { strip: await strip(page).count(), begins: await page.getByRole("heading", { name: "Begin with a design" }).count(), focus: await focus() }; };
  const door = page.getByRole("link", { name: "First page" }), on = page.getByRole("button", { name: "Go on with" });
  await number(page, "F1 x, mm", "-31");
  await current(page);
  const mine = await text();
  await (await part(page, "Comments")).locator("textarea").fill("half a comment");
  await door.press("Enter");
  found.first = await look();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  found.axe = await axe(page);
  await page.keyboard.press("Control+z"); // nothing that is not seen is undone
  await on.press("Enter");
  found.on = await look();
  found.draft = await page.locator("#comment-text").inputValue();
  await page.goBack();
  found.back = await look();
  await page.goForward();
  found.forward = await look();
  found.same = (await text()) === mine;
  await door.click();
  await page.getByRole("button", { name: asked.example }).click();
  await current(page);
  found.opened = { ...(await look()), other: (await text()) !== mine };
  await page.goBack();
  found.again = await look();
  await page.reload();
  await on.waitFor();
  found.reloaded = await look();
  await page.setInputFiles("header input[type=file]", { name: "beads.csv", mimeType: "text/csv", buffer: Buffer.from(asked.beads) });
  await page.locator("section.verdict").waitFor();
  await current(page);
  found.begun = (await text()).split("\n")[0];
  for (let k = 0; k < 2; k += 1) await page.keyboard.press("Control+z");
  await current(page);
  found.undone = (await text()) === mine;
  return found;
};

// An example of the gallery, opened and saved
scenarios.example = async () => {
  const page = await open(await newContext(), asked.url, false);
  await page.getByRole("button", { name: asked.example }).click();
  await current(page);
  await part(page, "Share and save");
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Save YAML" }).click()]);
  return { text: (await downloaded(download)).toString(), sha: await sha(page) };
};

// A section of the document that nobody told the page of: its fields, its line of the budget, and its number changed
scenarios.section = async () => {
  const page = await begun(await newContext()), all = await part(page, "All fields");
  await all.locator("summary", { hasText: asked.section }).click();
  const group = all.locator("details", { has: page.locator("summary", { hasText: asked.section }) }).last(), field = group.getByLabel(asked.field, { exact: true });
  await field.waitFor();
  const look = async () => ({ value: await field.inputValue(), p95: Number(await page.locator("#p95").textContent()), budget: await page.locator('[aria-label="Budget"]').innerText() });
  const before = await look(), sliders = await page.getByRole("slider", { name: new RegExp(asked.section, "i") }).count();
  await field.fill(asked.value);
  await field.press("Enter");
  await current(page);
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
  return { before, after: await look(), sliders };
};

export default scenarios;
