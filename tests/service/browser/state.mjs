// What becomes of the design on the workbench: opened, linked, saved, undone, read and written as YAML.
// See tests/service/test_workbench_state.py.
import { ASKED_AGAIN, asked, begun, bead, centre, current, drop, newContext, number, open, part, sha, state, take, unfold } from "./page.mjs";

const scenarios = {};
const settled = (page) => page.waitForFunction(() => !window.workbench.state().busy && (window.workbench.state().current || window.workbench.state().refused), null, ASKED_AGAIN);
const words = async (page) => (await page.locator(".message").allInnerTexts()).join("\n");

// The design that is open is opened again: as an example, and as a file
scenarios.again = async () => {
  const context = await newContext(), page = await open(context, asked.url, false), found = [];
  const look = async () => {
    await settled(page);
    found.push({ ...(await state(page)), score: null, p95: await page.locator("#p95").textContent(), images: await page.locator("figure.picture", { hasText: "X-ray" }).count() });
  };
  await page.getByRole("button", { name: asked.example }).click();
  await current(page);
  const gallery = await part(page, "Other designs");
  await gallery.getByRole("button", { name: asked.example }).click();
  await page.waitForFunction(() => document.activeElement?.id === "verdict"); // the card had the focus until its design was opened
  await look();
  await take(page, asked.design);
  await page.locator(".message", { hasText: "is open" }).waitFor();
  await current(page);
  await take(page, asked.design);
  await page.locator(".message", { hasText: "is what is open already" }).waitFor();
  await look();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return { found, words: await words(page) };
};

// A link, then an edit, then a reload; then the link again, and another file
scenarios.link = async () => {
  const context = await newContext(), page = await begun(context);
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await part(page, "Share and save");
  await page.getByRole("button", { name: "Link to this design" }).click();
  await page.getByText("The link holds the whole design").waitFor();
  const link = page.url(), linked = await sha(page);
  await page.reload();
  const kept = await sha(page), address = page.url();
  await number(page, "F2 x, mm", "27.25");
  const edited = await sha(page), cleared = page.url();
  await page.reload();
  const reloaded = await sha(page);
  await page.goto("about:blank");
  await page.goto(link);
  const opened = await sha(page);
  await take(page, asked.other);
  await page.waitForFunction((text) => window.workbench.state().text === text, asked.other);
  const other = await sha(page);
  await page.reload();
  return { linked, kept, link, address, edited, cleared, reloaded, opened, other, last: await sha(page) };
};

// A field behind an alias is slid, and so is what the alias stands for
scenarios.alias = async () => {
  const page = await begun(await newContext()), found = [], before = (await state(page)).text;
  await unfold(page);
  for (const pointer of asked.pointers) {
    const field = page.locator(`[data-pointer="${pointer}"]`).first(), slider = page.locator(`.slide:has([data-pointer="${pointer}"]) input[type=range]`);
    await slider.scrollIntoViewIfNeeded();
    const box = await slider.boundingBox();
    await page.mouse.click(box.x + 0.8 * box.width, box.y + box.height / 2);
    await page.locator(".message").waitFor();
    const said = await words(page); // now: after a while it leaves, and a score may take longer
    await sha(page);
    const { text, steps, score } = await state(page);
    found.push({ text, steps, value: Number(await field.inputValue()), p95: score.targets[0].p95_mm, words: said });
    if (asked.shot) await page.screenshot({ path: asked.shot });
    await page.keyboard.press("Control+z");
    await sha(page);
  }
  return { found, before, after: (await state(page)).text };
};

// Texts that are no design, as a link, as a file, typed, and as something that was saved
scenarios.unreadable = async () => {
  const context = await newContext(), page = await open(context, asked.url, false), found = [];
  const linkTo = (text) => page.evaluate(async (content) => {
    const packed = new Uint8Array(await new Response(new Blob([content]).stream().pipeThrough(new CompressionStream("deflate-raw"))).arrayBuffer());
    return `#design=${btoa(String.fromCharCode(...packed)).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "")}`;
  }, text);
  const links = [];
  for (const text of asked.texts) links.push(await linkTo(text));
  for (const hash of links) {
    await page.goto("about:blank");
    await page.goto(`${asked.url}${hash}`);
    await page.locator("#page h1").waitFor();
    found.push({ how: "link", shown: await page.locator("#page").innerText() });
  }
  if (asked.shot) await page.screenshot({ path: asked.shot });
  for (const text of asked.texts) {
    await page.goto("about:blank");
    await page.goto(asked.url);
    await drop(page, "strange.yaml", text);
    await page.locator(".message").waitFor();
    found.push({ how: "file", shown: await page.locator("#page").innerText() });
  }
  // as the page may find it saved
  for (const text of asked.texts) {
    await page.evaluate((content) => {
      localStorage.clear();
      sessionStorage.clear();
      localStorage.setItem("tailstack.workbench.design.some", JSON.stringify({ steps: [{ text: content, what: "Open" }], position: 0, at: Date.now() }));
      localStorage.setItem("tailstack.workbench.design", JSON.stringify({ steps: [{ text: content, what: "Open" }], position: 0, at: Date.now() }));
    }, text);
    await page.reload();
    await page.locator("#page h1").waitFor();
    found.push({ how: "saved", shown: await page.locator("#page").innerText() });
  }
  for (const shape of [5, "text", { a: 1 }, [1, null, { name: 3 }], [{ id: 1 }]]) {
    await page.evaluate((kept) => {
      localStorage.clear();
      sessionStorage.clear();
      for (const name of ["runs", "variants", "design", "design.some", "theme"]) localStorage.setItem(`tailstack.workbench.${name}`, JSON.stringify(kept));
    }, shape);
    await page.reload();
    await page.locator("#page h1").waitFor();
    await take(page, asked.design);
    await current(page).catch(() => null);
    for (const title of ["Run", "Versions"]) await part(page, title);
    found.push({ how: "shape", shown: await page.locator("#page").innerText() });
  }
  return { found };
};

// What is typed into the text: what is sent of it, what is said of it
scenarios.typed = async () => {
  const page = await begun(await newContext()), bodies = [], found = []; // but for what to do next of the design before
  page.on("request", (request) => { if (request.method() === "POST" && !request.url().endsWith("/batch")) bodies.push(request.postData() ?? ""); });
  for (const text of asked.texts) {
    const known = (await state(page)).text;
    bodies.length = 0;
    await page.evaluate(() => document.querySelectorAll(".message > button").forEach((button) => button.click()));
    await page.waitForFunction(() => !document.querySelector(".message"));
    await take(page, text);
    await page.waitForFunction((before) => window.workbench.state().text !== before || document.querySelector(".message"), known);
    await settled(page);
    const { current, refused, score, steps } = await state(page), scored = current && !refused;
    found.push({ steps, refused, bodies: [...bodies], sha: scored ? score.provenance.design_sha256 : null, p95: scored ? score.targets[0].p95_mm : null, strip: await page.locator(".verdict").innerText(), words: await words(page) });
    if (!scored) {
      await part(page, "Run");
      await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
      await page.locator("div.message.bad").waitFor(); // why it is not begun
      found[found.length - 1].runs = await page.locator(".runs > li").count();
      if (asked.shot) await page.screenshot({ path: asked.shot });
    }
  }
  return { found };
};

// Two tabs: the runs of one are those of the other
scenarios.tabs = async () => {
  const context = await newContext(), first = await begun(context), second = await open(context, asked.url);
  await number(second, "F2 x, mm", "27.25");
  await sha(second);
  for (const page of [first, second]) {
    await part(page, "Run");
    await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
    await page.locator(".runs > li").first().waitFor();
  }
  for (const page of [first, second]) await page.waitForFunction(() => document.querySelectorAll(".run[data-state=succeeded]").length === 2);
  const runs = (page) => page.locator(".runs > li").count(), live = [await runs(first), await runs(second)];
  await second.getByRole("button", { name: "Take off the list" }).first().click();
  await first.waitForFunction(() => document.querySelectorAll(".runs > li").length === 1);
  const third = await open(context, asked.url);
  await part(third, "Run");
  return { live, removed: await runs(first), third: await runs(third) };
};

// A tab that is duplicated, which begins with all that the first keeps for itself; then both are loaded anew
scenarios.twice = async () => {
  const context = await newContext(), first = await begun(context), found = [];
  await number(first, "F2 x, mm", "27.25");
  await number(first, "F2 x, mm", "27.5");
  await sha(first);
  await first.keyboard.press("Control+z");
  await sha(first);
  const own = await first.evaluate(() => ({ ...sessionStorage })), second = await context.newPage();
  await second.addInitScript((kept) => { if (!sessionStorage.length) Object.assign(sessionStorage, kept); }, own);
  await second.goto(asked.url);
  await current(second);
  const read = async (page) => found.push([await page.getByLabel("F2 x, mm", { exact: true }).inputValue(), (await state(page)).position, (await state(page)).steps]);
  await read(second);
  await number(second, "F2 x, mm", "29");
  await sha(second);
  for (const page of [first, second]) {
    await page.reload();
    await current(page);
    await read(page);
  }
  return { found, places: await first.evaluate(() => Object.keys(localStorage).filter((key) => key.startsWith("tailstack.workbench.design.")).length) };
};

// Text that is no design yet, while the design goes on by other means
scenarios.draft = async () => {
  const page = await begun(await newContext()), typed = "half: [1, 2", lines = page.locator(".editor .cm-content"), found = [];
  const look = async () => found.push([(await lines.innerText()).startsWith(typed), await page.getByText("This text is no design yet").count()]);
  const text = await part(page, "As text");
  await lines.click();
  await page.keyboard.press("Control+Home");
  await page.keyboard.insertText(`${typed}\n`);
  await page.getByText("This text is no design yet").waitFor();
  await number(page, "F2 x, mm", "27.25");
  await sha(page);
  await look();
  await text.locator("summary").first().click();
  await text.locator("summary").first().click();
  await lines.waitFor();
  await look();
  await page.reload();
  await current(page);
  await lines.waitFor();
  await look();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await page.getByRole("button", { name: "Leave it for the design's text" }).click();
  await look();
  const { text: kept } = await state(page);
  return { found, kept, shown: await lines.innerText() };
};

// What was run before is gone back to, after a version was kept
scenarios.back = async () => {
  const page = await begun(await newContext()), before = (await state(page)).text;
  await part(page, "Run");
  await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
  await page.locator(".runs > li").first().waitFor();
  await number(page, "F2 x, mm", "27.25");
  await sha(page);
  await (await part(page, "Versions")).getByRole("button", { name: "Keep this design as a version" }).click();
  await page.getByRole("button", { name: "Back to that design" }).click();
  await sha(page);
  return { before, after: (await state(page)).text };
};

// A key that is held, many presses, and how far back undo reaches
scenarios.presses = async () => {
  const page = await begun(await newContext()), first = await sha(page), found = [];
  const steps = async () => (await state(page)).steps;
  await page.getByRole("application", { name: /^Elevation Front/ }).focus();
  await page.keyboard.press("n");
  const now = Date.now(); // of the page too: presses within a second are one step
  await page.clock.setFixedTime(now);
  for (let k = 0; k < 20; k += 1) await page.keyboard.press(k % 2 ? "ArrowRight" : "ArrowUp");
  found.push(await steps());
  await page.clock.setFixedTime(now + 1100);
  await page.keyboard.press("ArrowRight");
  found.push(await steps());
  await page.keyboard.press("n");
  await page.keyboard.press("ArrowRight");
  found.push(await steps());
  const field = page.getByLabel("F2 x, mm", { exact: true });
  await field.evaluate(async (node) => { // from inside: each edit that is asked for from here is a frame that is drawn
    for (let k = 0; k < 350; k += 1) {
      node.value = String(20 + k / 100);
      node.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
      await null; // what follows of it is done before the next
    }
  });
  found.push(await steps());
  const last = await sha(page);
  await page.reload();
  await current(page);
  const reloaded = await sha(page), kept = await state(page);
  await page.evaluate(() => { for (let k = 0; k < 400; k += 1) document.dispatchEvent(new KeyboardEvent("keydown", { key: "z", ctrlKey: true, bubbles: true })); });
  return { found, first, last, reloaded, kept: kept.steps, size: await page.evaluate(() => Object.entries(localStorage).reduce((sum, [k, v]) => sum + k.length + v.length, 0)), undone: await sha(page) };
};

// The browser's storage is full, or refuses: what is on the page outlives a reload, and it is said
scenarios.full = async () => {
  const context = await newContext(), page = await begun(context), found = [];
  for (const how of ["full", "refuses"]) {
    await number(page, "F2 x, mm", how === "full" ? "28" : "27");
    await sha(page);
    await page.evaluate(() => {
      for (const size of [100000, 1000, 10]) {
        try { for (let k = 0; ; k += 1) localStorage.setItem(`fill ${size} ${k}`, "x".repeat(size)); } catch { /* full */ }
      }
    });
    if (how === "refuses") await page.evaluate(() => { const set = Storage.prototype.setItem; Storage.prototype.setItem = function (...given) { if (this === localStorage) throw new DOMException("full", "QuotaExceededError"); set.apply(this, given); }; });
    for (const x of ["27.25", "27.5", "27.75", "28.25", "28.5"]) await number(page, "F2 x, mm", x);
    const before = await sha(page), told = await page.getByText("The browser keeps nothing").count();
    if (how === "refuses") await page.addInitScript(() => { const set = Storage.prototype.setItem; Storage.prototype.setItem = function (...given) { if (this === localStorage) throw new DOMException("full", "QuotaExceededError"); set.apply(this, given); }; });
    await page.reload();
    found.push({ before, after: await sha(page), told, toldAgain: await page.getByText("The browser keeps nothing").count() });
  }
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return { found };
};

// Files of all kinds on a page without a design, and on one with a design
scenarios.files = async () => {
  const found = {};
  for (const started of [false, true]) {
    const context = await newContext(), page = started ? await begun(context) : await open(context, asked.url, false);
    for (const { name, base64 } of asked.files) {
      await page.evaluate(() => document.querySelector(".message button")?.click());
      await drop(page, name, Buffer.from(base64, "base64"));
      await page.locator(".message", { hasText: name }).waitFor();
      found[`${started ? "design" : "empty"} ${name}`] = { words: await words(page).catch(() => ""), text: (await state(page)).text };
    }
  }
  const page = await open(await newContext(), asked.url, false), images = asked.images.map((letters, k) => ({ name: `shot${k}`, mimeType: "", buffer: Buffer.from(letters, "base64") }));
  for (const some of [images, images.slice(1)]) {
    await page.setInputFiles("header input[type=file]", some);
    await page.locator(".message", { hasText: some.length > 1 ? "2 views are" : "a view is" }).waitFor();
    found[`${some.length} images`] = { words: await words(page), text: (await state(page)).text };
  }
  await page.route("**/v1/conversions*", (route) => route.abort());
  await drop(page, "beads.csv", Buffer.from(asked.files[0].base64, "base64"));
  await page.locator(".message", { hasText: "beads.csv" }).waitFor();
  found.away = { words: await words(page), text: (await state(page)).text };
  return { found };
};

// A run whose result the service no longer has; a wrong key
scenarios.gone = async () => {
  const context = await newContext(), page = await begun(context);
  await part(page, "Run");
  await page.getByRole("button", { name: /^Verify by Monte Carlo/ }).click();
  await page.locator(".run[data-kind=report][data-state=succeeded]").first().waitFor();
  await page.route("**/v1/results/**", (route) => route.fulfill({ status: 404, contentType: "application/problem+json", body: '{"title":"Not found","status":404,"errors":[]}' }));
  await page.reload();
  await current(page);
  await part(page, "Run");
  const run = page.locator(".runs > li").first();
  await page.locator(".runs > li[data-state=gone]").waitFor();
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
  return { state: await run.getAttribute("data-state"), shown: await run.innerText(), links: await run.locator("a").count() };
};

scenarios.key = async () => {
  const context = await newContext(), page = await open(context, asked.url, false), field = page.getByLabel(/API key/);
  await take(page, asked.design);
  await field.waitFor();
  await page.getByText("asks for an API key").first().waitFor();
  const asking = await page.locator("#page").innerText(), use = page.getByRole("button", { name: "Use it" });
  await field.fill("ключ");
  await use.click();
  const strange = await field.evaluate((node) => node.validationMessage);
  await field.fill("\u200b not a key\n");
  await use.click();
  await page.getByText("does not know this key").first().waitFor();
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return { asking, strange, wrong: await page.locator("#page").innerText() };
};

// Bytes of the text that a move of a bead changes
scenarios.written = async () => {
  const page = await begun(await newContext()), before = (await state(page)).text;
  const [x, y] = await centre(bead(page, "F10"));
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 20, y + 10, { steps: 3 });
  await page.mouse.up();
  await sha(page);
  const moved = (await state(page)).text;
  await page.getByRole("button", { name: "Lose F3: take it out" }).click();
  await sha(page);
  return { before, moved, lost: (await state(page)).text };
};

export default scenarios;
