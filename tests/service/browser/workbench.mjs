// Uses the workbench in Chromium as a designer does: one scenario of those below.  See tests/service/test_workbench.py.
import { asked, axe, bead, begun, centre, current, downloaded, drawn, drop, faded, newContext, number, open, part, sha, state, take, tell, unfold, unhurried, wide } from "./page.mjs";

const scenarios = {
  // From nothing: the gallery, the first score, what it shows, how much was fetched
  async first() {
    const context = await newContext(), page = await open(context, asked.url, false);
    await page.getByRole("button", { name: asked.example }).click();
    await current(page);
    await page.locator(".space canvas").first().waitFor();
    const sizes = await page.evaluate(() => performance.getEntriesByType("resource").concat(performance.getEntriesByType("navigation"))
      .filter((entry) => !entry.name.includes("/v1/")).reduce((sum, entry) => sum + entry.transferSize, 0));
    const light = await axe(page);
    for (const title of ["Views, pivots, targets, limits", "Run", "Versions", "Comments", "Share and save", "All fields", "As text"]) await part(page, title);
    await page.locator(".editor").waitFor();
    const opened = await axe(page);
    await page.addInitScript(() => {
      const requests = () => performance.getEntriesByType("resource").map((entry) => new URL(entry.name).pathname).filter((path) => path.includes("/v1/"));
      const look = () => { if (document.querySelector('[data-current="true"]')) window.awaited = requests(); else requestAnimationFrame(look); };
      look();
    });
    await page.reload();
    await current(page);
    const awaited = await (await page.waitForFunction(() => window.awaited)).jsonValue(); // before the number was there
    await page.emulateMedia({ colorScheme: "dark" });
    const dark = await axe(page);
    if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
    const { score } = await state(page);
    return { sizes, light, opened, dark, awaited, p95: await page.locator("#p95").textContent(), score };
  },

  // Fifty edits of all kinds, undone one by one, done again one by one
  async undo() {
    const context = await newContext(), page = await begun(context), first = await sha(page);
    await unfold(page);
    let random = asked.seed;
    const draw = (n) => { random = (Math.imul(random, 1103515245) + 12345) >>> 0; return (random >>> 8) % n; };
    const before = (await state(page)).position;
    for (let k = 0; k < asked.edits; k += 1) {
      const label = `F${1 + draw(12)}`;
      if (draw(3) === 0) {
        const [x, y] = await centre(bead(page, label, draw(2) ? "Top (x, y)" : "AP: X-ray image"));
        await page.mouse.move(x, y);
        await page.mouse.down();
        await page.mouse.move(x + 3 + draw(9), y - 2 - draw(9), { steps: 3 });
        await page.mouse.up();
      } else if (draw(2)) {
        const field = page.getByLabel(`${label} y, mm`, { exact: true });
        await field.fill(String((draw(600) - 300) / 10));
        await field.press("Enter");
      } else {
        const slider = page.locator(".slide input[type=range]").nth(draw(12));
        await slider.focus();
        await slider.press("PageUp");
      }
    }
    const last = await sha(page), end = await state(page), texts = [];
    for (let k = end.position; k > before; k -= 1) {
      await page.keyboard.press("Control+z");
      texts.push((await state(page)).position);
    }
    const undone = await sha(page);
    while ((await state(page)).position < end.position) await page.keyboard.press("Control+Shift+z");
    return { first, last, undone, redone: await sha(page), steps: end.position - before, texts };
  },

  // The link holds the design; a reload and a crash lose nothing; tabs do not disturb each other
  async keep() {
    const context = await newContext(), page = await begun(context);
    await context.grantPermissions(["clipboard-read", "clipboard-write"]);
    const field = page.getByLabel("F2 x, mm", { exact: true });
    await field.fill("27.25");
    await field.press("Enter");
    const mine = await sha(page);
    await part(page, "Share and save");
    await page.getByRole("button", { name: "Link to this design" }).click();
    await page.getByText("The link holds the whole design").waitFor();
    const link = page.url();
    const elsewhere = await open(await newContext(), link);
    const linked = await sha(elsewhere);
    await page.reload();
    const reloaded = await sha(page);
    const other = await open(context, asked.url);
    const inherited = await sha(other);
    await other.getByLabel("F2 x, mm", { exact: true }).fill("26");
    await other.getByLabel("F2 x, mm", { exact: true }).press("Enter");
    const theirs = await sha(other), undisturbed = await sha(page);
    await page.reload();
    const still = await sha(page);
    await page.goto("chrome://crash").catch(() => null);
    const after = await open(context, asked.url);
    const noise = Array.from({ length: 3000 }, (_, k) => ((k * 7919 * 104729) % 1679616).toString(36)); // does not compress
    const large = `${asked.design}\n# ${noise.join(" ").replace(/(.{100}) /g, "$1\n# ")}\n`;
    await take(after, large);
    await current(after);
    await part(after, "Share and save");
    const [download] = await Promise.all([after.waitForEvent("download"), after.getByRole("button", { name: "Link to this design" }).click()]);
    return { mine, linked, reloaded, inherited, theirs, undisturbed, still, link: link.length, file: download.suggestedFilename(), words: await after.locator(".message").textContent() };
  },

  // Names that are code, right to left, or long: shown as text, and nothing is pushed out of the page
  async names() {
    const context = await newContext(), page = await begun(context);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
    for (const title of ["Views, pivots, targets, limits", "All fields"]) await part(page, title);
    const opened = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
    if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
    return { wide, opened, scripts: await page.evaluate(() => document.querySelectorAll("#page script").length), hacked: await page.evaluate(() => window.hacked ?? null), name: await page.locator("h1 .name").textContent() };
  },

  // What cannot be answered is explained, the last number is not shown as current, and undo is one step away
  async refused() {
    const context = await newContext(), page = await begun(context), before = await sha(page);
    const field = page.getByLabel("F3 z, mm", { exact: true });
    await field.fill("-120");
    await field.press("Enter");
    await page.locator(".verdict.refused").waitFor();
    const words = await page.locator(".verdict").innerText(), shown = await page.locator(".verdict").getAttribute("data-current");
    const old = await page.locator(".verdict .numbers.old").count();
    if (asked.shot) await page.screenshot({ path: asked.shot });
    await page.getByRole("button", { name: "Undo the last change" }).click();
    return { words, shown, old, before, after: await sha(page) };
  },

  // The whole job by mouse: move, loosen, verify, optimise, take the optimum, report
  async mouse() {
    const context = await unhurried(), page = await begun(context);
    const [x, y] = await centre(bead(page, "F5"));
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 12, y + 6, { steps: 4 });
    await page.mouse.up();
    const moved = await sha(page);
    const slider = await page.locator(".slide input[type=range]").first().elementHandle(), box = await slider.boundingBox(), middle = box.y + box.height / 2;
    await page.mouse.move(box.x + 0.66 * box.width, middle); // beside the knob, at 0.2°
    await page.mouse.down();
    await page.mouse.move(box.x + 0.6 * box.width, middle, { steps: 4 });
    await current(page);
    const still = (await slider.boundingBox())?.y === box.y;
    await page.mouse.move(box.x + 0.66 * box.width, middle, { steps: 4 });
    await page.mouse.up();
    const loosened = await sha(page);
    await part(page, "Run");
    await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
    await page.locator('.run[data-kind=report][data-state=succeeded] .histogram').waitFor();
    const histogram = await page.locator(".histogram").evaluate((node) => ({ words: node.textContent, bars: node.querySelectorAll("rect").length }));
    await page.getByRole("button", { name: "Optimise", exact: true }).click();
    await page.locator('.run[data-kind=optimisation][data-state=succeeded]').waitFor();
    await page.getByRole("button", { name: /Take this design/ }).click();
    const taken = await sha(page), { score } = await state(page);
    await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
    const last = page.locator(".runs > li").first(), report = last.locator("a", { hasText: "HTML" });
    await page.waitForFunction(() => document.querySelector(".runs > li")?.matches("[data-kind=report][data-state=succeeded]"));
    if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
    const [tab] = await Promise.all([context.waitForEvent("page"), report.click()]);
    await tab.waitForLoadState();
    await page.bringToFront();
    const title = await tab.title(), texts = (await state(page)).text;
    await page.getByRole("button", { name: /^Undo/ }).first().click();
    return { moved, still, loosened, taken, histogram, status: score.verdict.status, title, undone: await sha(page), comments: (texts.match(/#/g) ?? []).length };
  },

  // The same by the keyboard alone
  async keyboard() {
    const context = await newContext(), page = await begun(context), first = await sha(page);
    const focused = () => page.evaluate(() => { const at = document.activeElement; return `${at?.getAttribute("aria-label") ?? ""} ${at?.textContent ?? ""} ${at?.dataset?.pointer ?? ""}`; });
    const tabTo = async (pattern, key = "Tab") => {
      for (let k = 0; k < 400; k += 1) {
        await page.keyboard.press(key);
        if (pattern.test(await focused())) return;
      }
      throw new Error(`the keyboard does not reach ${pattern}`);
    };
    await page.evaluate(() => document.body.focus());
    await tabTo(/^Elevation Front/);
    await page.keyboard.press("n");
    await page.keyboard.press("ArrowRight");
    await page.keyboard.press("Shift+ArrowUp");
    const moved = await sha(page);
    await tabTo(/: half-width /);
    await page.keyboard.press("ArrowRight");
    const loosened = await sha(page);
    await tabTo(/^ Run/, "Shift+Tab"); // it stands before the list
    await page.keyboard.press("Enter");
    await tabTo(/^ Verify by Monte Carlo/);
    await page.keyboard.press("Enter");
    await page.locator('.run[data-kind=report][data-state=succeeded] table').first().waitFor();
    await page.keyboard.press("Tab");
    await page.keyboard.press("Enter");
    await page.locator('.run[data-kind=optimisation][data-state=succeeded] table').waitFor();
    await tabTo(/Take this design/);
    await page.keyboard.press("Enter");
    const taken = await sha(page);
    await page.keyboard.press("Control+z");
    return { first, moved, loosened, taken, undone: await sha(page) };
  },

  // The service is killed during a job and started again: the page goes on by itself
  async restart() {
    const context = await newContext(), page = await begun(context);
    await part(page, "Run");
    await page.getByRole("button", { name: "Optimise", exact: true }).click();
    await page.locator('.run[data-kind=optimisation][data-state=running]').waitFor();
    tell({ said: "kill" });
    await page.getByText("The service does not answer").first().waitFor();
    tell({ said: "told" });
    await page.locator('.run[data-kind=optimisation][data-state=succeeded]').waitFor();
    const field = page.getByLabel("F2 x, mm", { exact: true });
    await field.fill("28");
    await field.press("Enter");
    return { sha: await sha(page) };
  },

  // Many of everything: the number of a change is there in the end, typed and dragged; how much of the page a move
  // changes, and how many scores a drag asks for
  async large() {
    const context = await newContext(), page = await begun(context), answered = [], frames = [];
    let scores = 0;
    page.on("request", (request) => { scores += Number(request.url().endsWith("/v1/scores")); });
    const shown = async (name, act) => {
      await act();
      await current(page);
      answered.push(name);
    };
    await shown("typed", () => number(page, "F1 x, mm", "-30"));
    const typed = scores, [x, y] = await centre(bead(page, "F1", "Top (x, y)"));
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.evaluate(() => {
      const seen = new MutationObserver((all) => all.forEach((one) => window.changes.add(one.target)));
      seen.observe(document.body, { subtree: true, childList: true, attributes: true, characterData: true });
    });
    for (let k = 1; k <= 12; k += 1) {
      await page.evaluate(() => { window.changes = new Set(); });
      await page.mouse.move(x, y - k / 2); // away from F0
      await drawn(page);
      frames.push(await page.evaluate(() => window.changes.size));
    }
    await shown("dragged", () => page.mouse.up());
    if (asked.shot) await page.screenshot({ path: asked.shot });
    return { answered, frames, all: await page.evaluate(() => document.querySelectorAll("*").length), typed, dragged: scores - typed, wide: await wide(page) };
  },

  // The page at a width, as a picture
  async look() {
    const context = await newContext(), page = await begun(context);
    await page.locator(".space canvas").first().waitFor();
    await faded(page);
    await page.screenshot({ path: asked.shot, fullPage: asked.full ?? false });
    return { wide: await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth) };
  },
};


// What the page looks like in three states, and which of its parts are in sight in each
scenarios.states = async () => {
  const context = await unhurried(), page = await open(context, asked.url, false), found = {};
  const take = async (name) => {
    await faded(page);
    await page.screenshot({ path: `${asked.folder}/workbench_${name}.png` });
    found[name] = { text: await page.locator("#page").innerText(), wide: await wide(page), parts: await page.locator("h2:visible, figure:visible figcaption").evaluateAll((all) => all.map((one) => one.innerText.split("\n")[0])) };
  };
  await page.waitForFunction(() => { const cards = [...document.querySelectorAll(".gallery li")]; return cards.length && cards.every((card) => card.querySelector(".status")); });
  await take("start");
  await page.getByRole("button", { name: asked.example }).click();
  await current(page);
  await page.getByRole("note", { name: "The first minute" }).getByRole("button", { name: "Skip" }).click();
  const [x, y] = await centre(bead(page, "F10", "AP: X-ray image"));
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x - 40, y + 20, { steps: 4 });
  await current(page);
  await take("change");
  await page.mouse.up();
  await page.keyboard.press("Control+z");
  await part(page, "Run");
  await page.getByRole("button", { name: "Optimise", exact: true }).click();
  await page.locator(".run[data-kind=optimisation][data-state=succeeded] table").waitFor();
  await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
  await page.locator(".run[data-kind=report][data-state=succeeded] .histogram").waitFor();
  await page.getByRole("button", { name: "Per unit, and if fiducials are not found" }).click();
  await page.locator(".run .histogram").first().evaluate((node) => node.scrollIntoView({ block: "center" }));
  await take("after");
  await page.emulateMedia({ media: "print" });
  found.print = { text: await page.locator("#page").innerText(), buttons: await page.locator("button:visible").count(), pdf: (await page.pdf({ format: "A4" })).length };
  return found;
};

// A service that asks for a key: a wrong one is asked for again, the right one is nowhere but in memory
scenarios.key = async () => {
  const context = await newContext(), page = await open(context, asked.url, false), field = page.getByLabel(/API key/);
  const give = async (key) => {
    await field.fill(key);
    await page.getByRole("button", { name: "Use it" }).click();
  };
  await take(page, asked.design);
  await field.waitFor();
  await give("not a key");
  await page.getByText("does not know this key").first().waitFor();
  await field.waitFor();
  await give(asked.key);
  const right = await sha(page);
  await part(page, "Run");
  await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
  await page.locator(".run[data-kind=report][data-state=succeeded] .histogram").waitFor();
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator(".run a", { hasText: "PDF" }).click()]);
  const kept = JSON.stringify([await page.evaluate(() => [{ ...localStorage }, { ...sessionStorage }, document.cookie, location.href]), await context.cookies()]);
  await page.reload();
  await field.waitFor();
  return { sha: right, kept, download: (await downloaded(download)).subarray(0, 5).toString(), name: download.suggestedFilename() };
};

// Jobs that somebody else started are listed with their reports and can be shown; one of this page outlives a reload
scenarios.jobs = async () => {
  const context = await newContext(), page = await begun(context);
  await part(page, "Run");
  await page.getByRole("button", { name: "Optimise", exact: true }).click();
  await page.locator(".run[data-kind=optimisation]").waitFor();
  await page.reload();
  await page.locator(".run[data-kind=optimisation][data-state=succeeded]").waitFor();
  await page.locator("summary", { hasText: "Recent jobs" }).click();
  const row = page.locator(`tr[data-job="${asked.job}"]`);
  await row.waitFor();
  const words = await row.innerText(), links = await row.locator("a").evaluateAll((all) => all.map((a) => a.href));
  await row.getByRole("button").click();
  await page.locator(".run[data-kind=report] .histogram").waitFor();
  await page.locator(".run[data-kind=report]").getByRole("button", { name: "Back to that design" }).click();
  return { words, links, sha: await sha(page) };
};

// What is copied, as it is copied
scenarios.copy = async () => {
  const context = await newContext(), page = await begun(context), found = {};
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await part(page, "Share and save");
  for (const name of ["curl", "Python", "command", "CI gate"]) {
    await page.getByRole("button", { name: `Copy as ${name}` }).click();
    await page.getByText(`Copied as ${name}`).waitFor();
    found[name] = await page.evaluate(() => navigator.clipboard.readText());
  }
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Save YAML" }).click()]);
  return { ...found, name: download.suggestedFilename(), yaml: (await downloaded(download)).toString(), p95: (await state(page)).score.targets[0].p95_mm };
};

// How far a half-width may change until the limit is reached, tried out
scenarios.slack = async () => {
  const context = await newContext(), page = await begun(context);
  await page.getByRole("button", { name: "How far may each be loosened?" }).click();
  const slack = await page.locator(`.slide:has([data-pointer="${asked.pointer}"]) .slack`).innerText(), field = page.locator(`[data-pointer="${asked.pointer}"]`).first();
  await page.locator(`.slide:has([data-pointer="${asked.pointer}"]) .slack button`).click();
  await current(page);
  return { slack, width: Number(await field.inputValue()), value: (await state(page)).score.verdict.checks[0].value };
};

// A slider stops at the process grades that the design lists for this tolerance
scenarios.grades = async () => {
  const context = await newContext(), page = await begun(context);
  await unfold(page);
  const slider = page.locator(`.slide:has([data-pointer="${asked.pointer}"]) input[type=range]`);
  const stops = await page.locator(`.slide:has([data-pointer="${asked.pointer}"]) option`).evaluateAll((all) => all.map((option) => Number(option.value)));
  await slider.scrollIntoViewIfNeeded();
  const box = await slider.boundingBox(), values = [];
  for (const stop of stops) {
    await page.mouse.click(box.x + 8 + (box.width - 16) * ((stop + 6) / 1000), box.y + box.height / 2);
    await current(page);
    values.push(await page.locator(`[data-pointer="${asked.pointer}"]`).inputValue());
  }
  return { values };
};

// A version: drawn below, compared field by field, taken back
scenarios.versions = async () => {
  const context = await newContext(), page = await begun(context), first = await sha(page);
  await part(page, "Versions");
  await page.getByRole("button", { name: "Keep this design as a version" }).click();
  await number(page, "F2 x, mm", "7.25");
  const moved = await sha(page);
  await page.getByLabel("Draw A below").check();
  const ghosts = await page.locator("figure.picture", { hasText: "Top (x, y)" }).locator("circle.ghost").count();
  await page.getByRole("button", { name: "compare", exact: true }).click();
  const differences = await page.locator('[aria-label="Differences from version A"] tbody').innerText();
  const row = await page.locator('[aria-label="Versions"] tbody').innerText();
  await page.getByRole("button", { name: "take", exact: true }).click();
  return { first, moved, ghosts, differences, row, taken: await sha(page) };
};

// A review: two versions that outlive undo, as one report; comments pinned, settled, undone; all of it in the file
scenarios.review = async () => {
  const context = await newContext(), page = await begun(context), first = await sha(page), sent = [];
  page.on("request", (request) => { if (/\/v1\/scores$/.test(request.url())) sent.push(request.postData()); });
  await part(page, "Versions");
  const names = () => page.locator('[aria-label="Versions"] tbody th').allInnerTexts();
  const keep = async (name, note) => {
    await page.getByRole("form", { name: "Keep a version" }).getByLabel("Name").fill(name);
    await page.getByRole("form", { name: "Keep a version" }).getByLabel("Note").fill(note);
    await page.getByRole("button", { name: "Keep this design as a version" }).click();
  };
  await number(page, "F2 x, mm", "7.25");
  const moved = await sha(page);
  await keep("close", "as the shop asked");
  await page.keyboard.press("Control+z");
  const undone = await sha(page), kept = await names();
  await keep("", "");
  await page.keyboard.press("Control+Shift+z");
  const both = await names();
  await page.getByRole("row", { name: /^close/ }).getByRole("button", { name: "compare", exact: true }).click();
  const choice = page.getByLabel("close against");
  await choice.selectOption("A");
  const pair = page.getByRole("region", { name: "close against A" });
  await pair.getByRole("region", { name: "Budgets side by side" }).waitFor();
  const budgets = await pair.getByRole("region", { name: "Budgets side by side" }).locator("tbody tr").count(), dots = await pair.locator(".dots figure").count();
  const saved = async (press) => { const [file] = await Promise.all([page.waitForEvent("download"), press()]); return { name: file.suggestedFilename(), text: (await downloaded(file)).toString("latin1") }; };
  const pdf = await saved(() => pair.getByRole("button", { name: /^Report: close against A/ }).click());
  await part(page, "Comments");
  const before = sent.length, form = page.getByRole("form", { name: /comment/ }), said = page.locator(".comments > li");
  for (const [on, text] of [["bead F3", asked.hostile], ["structure_connector rx", "hold 0.05"]]) {
    await form.getByLabel("On").selectOption({ label: on });
    await form.getByLabel("By").fill("A. Okafor");
    await form.getByLabel("Comment", { exact: true }).fill(text);
    await form.getByRole("button", { name: "Comment" }).click();
  }
  const pins = { rows: await page.locator("button.pin").evaluateAll((all) => all.map((one) => [one.title, one.closest("tr").querySelector("th").firstChild.textContent])), pictures: await page.locator("path.pin").evaluateAll((all) => all.map((one) => one.parentNode.dataset.bead)) };
  await page.locator("button.pin", { hasText: "1" }).nth(1).click();
  await drawn(page);
  pins.led = await said.evaluateAll((all) => all.findIndex((one) => one.contains(document.activeElement)));
  await said.nth(1).getByRole("button", { name: "resolve" }).click();
  pins.left = await page.locator(".budget button.pin").count();
  await said.nth(0).getByRole("button", { name: "edit" }).click();
  await form.getByLabel("Comment", { exact: true }).fill(`${asked.hostile}!`);
  await form.getByRole("button", { name: "Change it" }).click();
  await said.nth(1).getByRole("button", { name: "Delete comment 2" }).click();
  const one = await said.count();
  await page.getByRole("button", { name: "show", exact: true }).focus();
  await page.keyboard.press("Control+z");
  const comments = await said.allInnerTexts(), again = sent.length - before, found = await axe(page);
  await part(page, "Share and save");
  const yaml = await saved(() => page.getByRole("button", { name: "Save YAML" }).click());
  const sheets = {};
  for (const form of ["PDF", "CSV"]) sheets[form] = await saved(() => page.getByRole("button", { name: `Sheet for the supplier as ${form}` }).click());
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
  return { first, moved, undone, kept, both, budgets, dots, pdf, pins, one, comments, again, found, yaml, sheets, hacked: await page.evaluate(() => window.hacked ?? null), sha: await sha(page) };
};

// A bead is taken out, and brought back
scenarios.lose = async () => {
  const context = await newContext(), page = await begun(context), before = await sha(page);
  await page.getByRole("button", { name: `Lose ${asked.label}: take it out` }).click();
  const without = await sha(page);
  const labels = await page.locator(".beads tbody tr > th").allInnerTexts();
  await page.getByRole("button", { name: "Per unit, and if fiducials are not found" }).click();
  const losses = await page.getByRole("region", { name: "Lost fiducials" }).innerText();
  const drawn = page.locator(".viewer-layers label", { hasText: `Fiducials (${labels.length})` });
  await drawn.waitFor({ state: "attached" }); // the drawing in space follows a moment later
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
  await page.keyboard.press("Control+z");
  return { before, without, labels, losses, after: await sha(page) };
};

// Files dropped on the page, one after the other
// A view at a price: what the page says of it, and the design that is taken
scenarios.offer = async () => {
  const page = await begun(await newContext());
  await part(page, "Run");
  await page.getByRole("button", { name: "Optimise", exact: true }).click();
  const run = page.locator(".run[data-kind=optimisation][data-state=succeeded]");
  const taking = run.getByRole("button", { name: /Take this design/ });
  await taking.waitFor(); // a run has ended before its result is there
  const words = await run.innerText();
  await taking.click();
  return { words, taken: await sha(page) };
};

scenarios.drop = async () => {
  const context = await newContext(), page = asked.empty ? await open(context, asked.url, false) : await begun(context), found = [];
  for (const { name, text } of asked.files) {
    await drop(page, name, text);
    if (asked.balls) await page.getByRole("button", { name: asked.balls }).click();
    await page.locator(".message", { hasText: name }).waitFor();
    await page.waitForFunction(() => !window.workbench.state().busy);
    found.push({ words: await page.locator(".message").innerText(), labels: await page.locator(".beads tbody tr > th").allInnerTexts() });
  }
  return { found };
};

// How far the keys move a bead
scenarios.keys = async () => {
  const context = await newContext(), page = await begun(context);
  const at = async () => (await page.getByLabel("F1 x, mm", { exact: true }).inputValue()) * 1, found = [];
  await page.getByRole("application", { name: /^Elevation Front/ }).focus();
  await page.keyboard.press("n");
  for (const key of ["ArrowRight", "Shift+ArrowRight", "Alt+ArrowRight"]) {
    const before = await at();
    await page.keyboard.press(key);
    await current(page);
    found.push(Number(((await at()) - before).toFixed(6)));
  }
  return { found };
};

// How long moves take to their numbers, in turn with the same request alone; then in how many frames of a steady drag the
// numbers are black, and in how many they are of the design of that moment.  For benchmarks/service.py, not for a test.
scenarios.pace = async () => {
  const context = await newContext(), page = await begun(context), [x, y] = await centre(bead(page, "F1")), moves = [], alone = [];
  let last;
  page.on("request", (request) => { if (request.url().endsWith("/v1/scores")) last = request; });
  await page.evaluate(() => {
    document.addEventListener("pointermove", () => { window.moved = performance.now(); }, { capture: true });
    window.isCurrent = () => window.workbench.state().current && document.querySelector('[data-current="true"]');
  });
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let k = 0; k < asked.moves; k += 1) {
    await page.evaluate(() => { window.moved = 0; });
    await page.mouse.move(x + 2 + 36 * Math.sin(k / 7), y + 24 * Math.cos(k / 5));
    moves.push(await page.evaluate(() => new Promise((done) => {
      const look = () => window.moved && window.isCurrent() ? done(performance.now() - window.moved) : requestAnimationFrame(look);
      look();
    })));
    alone.push(await page.evaluate(async ([body, type]) => {
      const begun = performance.now();
      await (await fetch("/v1/scores", { method: "POST", headers: { "Content-Type": type }, body })).json();
      return performance.now() - begun;
    }, [last.postData(), last.headers()["content-type"]]));
  }
  await page.evaluate(() => {
    window.counted = { all: 0, black: 0, current: 0 };
    const count = () => {
      window.counted.all += 1;
      window.counted.black += Number(!document.querySelector(".budget.outdated"));
      window.counted.current += Number(Boolean(document.querySelector('[data-current="true"]')));
      requestAnimationFrame(count);
    };
    requestAnimationFrame(count);
  });
  for (let k = 0; k < asked.moves; k += 1) {
    await page.mouse.move(x + 2 + 36 * Math.sin(k / 7), y + 24 * Math.cos(k / 5));
    await page.waitForTimeout(50);
  }
  const { all, black, current: exact } = await page.evaluate(() => window.counted);
  await page.mouse.up();
  return { moves, alone, black: black / all, current: exact / all };
};

// Of which targets the moves of a drag ask, and what is shown meanwhile: as the page is opened, with another target's
// budget, with a table of all targets; each time also once the bead is let go.
scenarios.told = async () => {
  const context = await unhurried(), page = await begun(context), found = [];
  let last;
  page.on("request", (request) => {
    const body = request.url().endsWith("/v1/scores") ? request.postDataJSON() : {};
    if (body.fifty_shots === true) last = body.targets ?? "all";
  });
  const now = async () => ({ asked: last, p95: await page.locator("#p95").innerText(), told: (await state(page)).score.targets.map(({ name }) => name), offered: await page.locator(".budget select option").allInnerTexts(), budget: await page.locator(".budget select").inputValue() });
  const drag = async () => {
    const [x, y] = await centre(bead(page, asked.bead));
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x + 9, y, { steps: 3 });
    await current(page);
    const moving = await now();
    await page.mouse.up();
    await current(page);
    found.push([moving, await now()]);
  };
  await drag();
  await page.locator(".budget select").selectOption(asked.other);
  await drag();
  await page.getByText("Shares at every target").click();
  await drag();
  return { found, columns: await page.getByRole("region", { name: "Contributors by target" }).locator("thead th").count() };
};

// Moves of the pointer, each to its own number on the page; then many at once.
scenarios.drag = async () => {
  const context = await unhurried(), page = await begun(context);
  const [x, y] = await centre(bead(page, "F1")), shown = [], tops = new Set();
  // The strip's own number has its fifty shots; what is asked once a design rests, as a busy machine lets it, has none
  const ofStrip = (request) => request.url().endsWith("/v1/scores") && request.postDataJSON().fifty_shots === true;
  let scores = 0;
  page.on("request", (request) => { scores += Number(ofStrip(request)); });
  await page.evaluate(() => {
    document.addEventListener("pointermove", () => { window.moved = true; }, { capture: true });
    window.settled = () => new Promise((done) => {
      const look = () => {
        const { current } = window.workbench.state();
        if (window.moved && current && document.querySelector('[data-current="true"]')) done([document.querySelector("#p95").parentElement.textContent, document.querySelector('svg[aria-label^="Elevation Front"]').getBoundingClientRect().top]);
        else requestAnimationFrame(look);
      };
      look();
    });
  });
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let k = 0; k < asked.moves; k += 1) {
    await page.evaluate(() => { window.moved = false; });
    await page.mouse.move(x + 2 + 36 * Math.sin(k / 7), y + 24 * Math.cos(k / 5));
    const [p95, top] = await page.evaluate(() => window.settled());
    shown.push(p95);
    tops.add(top);
  }
  await page.mouse.up();
  await page.mouse.move(x, y);
  await current(page);
  const { position } = await state(page), alone = scores;
  // many moves at once: never more than one request, and the last design's number in the end
  let inFlight = 0, mostInFlight = 0, requests = 0;
  await page.route("**/v1/scores", async (route) => {
    if (!ofStrip(route.request())) return route.continue();
    mostInFlight = Math.max(mostInFlight, ++inFlight);
    requests += 1;
    const answer = await route.fetch();
    inFlight -= 1; // the page cannot know of the answer yet
    await route.fulfill({ response: answer });
  });
  await page.mouse.down();
  for (let k = 0; k < 60; k += 1) await page.mouse.move(x + k / 3, y);
  await page.mouse.up();
  await sha(page);
  return { shown, tops: [...tops], alone, mostInFlight, requests, position };
};

export default scenarios;
