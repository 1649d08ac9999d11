// How the workbench is used by the scenarios of the scripts beside this one; what is asked of one is {limit, url, ...}.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const require = createRequire(import.meta.url);
export const AXE = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");
export let asked, browser; // of the scenario that is played
let watched;

export async function open(context, url = asked.url, answered = true) {
  const page = await context.newPage();
  page.on("console", (said) => ["error", "warning"].includes(said.type()) && watched.messages.push(said.text()));
  page.on("pageerror", (error) => watched.messages.push(`error: ${error.message}`));
  page.on("request", (request) => {
    const address = new URL(request.url());
    if (!["data:", "blob:"].includes(address.protocol) && address.origin !== new URL(asked.url).origin) watched.strangers.push(request.url());
  });
  await page.goto(url);
  if (answered) await current(page);
  return page;
}

export async function newContext(more = {}) {
  const context = await browser.newContext({
    viewport: { width: asked.width ?? 1280, height: asked.height ?? 900 }, colorScheme: asked.scheme ?? "light", reducedMotion: "reduce",
    acceptDownloads: true, serviceWorkers: "block", ...more,
  });
  context.setDefaultTimeout(asked.limit);
  return context;
}
/** One whose stopwatch stands still.  Where scores take long the page asks for none while something is held, and on a busy
 * machine they may: a scenario that holds something and waits for its number needs a page that never finds it so. */
export async function unhurried(more = {}) {
  const context = await newContext(more);
  await context.addInitScript(() => { performance.now = () => 0; });
  return context;
}
/** One whose clock stands still: presses are those in a row that make one step, however busy the machine is. */
export async function timeless(context) {
  await context.addInitScript(() => { Date.now = () => 1e12; });
  return context;
}
/** What was done to the page so far is drawn. */
export const drawn = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
/** And what fades has faded. */
export async function faded(page) {
  await drawn(page);
  await page.evaluate(() => Promise.allSettled(document.getAnimations().filter((one) => one instanceof CSSTransition).map((one) => one.finished)));
}
// Not at each frame, which is what playwright does: frames are drawn for it, by the processor
export const ASKED_AGAIN = { polling: 50 };
export const state = (page) => page.evaluate(() => window.workbench.state());
export const current = (page) => page.waitForFunction(() => window.workbench.state().current && !window.workbench.state().busy, null, ASKED_AGAIN);
/** Of the design whose score stands there: asked in one go, for a file that is being opened takes the score away. */
export const sha = async (page) => {
  const shown = () => { const { current, busy, score } = window.workbench.state(); return current && !busy && score?.provenance.design_sha256; };
  return (await page.waitForFunction(shown, null, ASKED_AGAIN)).jsonValue();
};
export const take = (page, text, name = "design.yaml") =>
  page.setInputFiles("header input[type=file]", { name, mimeType: "application/yaml", buffer: Buffer.from(text) });

/** What a download holds: the browser keeps it, which is no child of this process. */
export async function downloaded(download) {
  const parts = [];
  for await (const part of await download.createReadStream()) parts.push(part);
  return Buffer.concat(parts);
}

/** A file from elsewhere: text, or bytes, which are not passed to a page as they are. */
export async function drop(page, name, content) {
  const dropped = await page.evaluateHandle(([called, letters]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(atob(letters), (letter) => letter.charCodeAt(0))], called));
    return transfer;
  }, [name, Buffer.from(content).toString("base64")]);
  await page.dispatchEvent("body", "drop", { dataTransfer: dropped });
}

export async function begun(context) {
  const page = await open(context, asked.url, false);
  await take(page, asked.design);
  await current(page);
  return page;
}

export async function part(page, title) {
  const details = page.locator("details.part", { has: page.getByRole("heading", { name: title, exact: true }) });
  if (!(await details.evaluate((node) => node.open))) await details.locator("summary").first().click();
  return details;
}

export const bead = (page, label, picture = "Front (x, z)") =>
  page.locator("figure.picture", { has: page.locator("figcaption", { hasText: picture }) }).locator(`g.bead[data-bead="${label}"] circle.mark`);

export async function centre(locator) {
  await locator.scrollIntoViewIfNeeded();
  const box = await locator.boundingBox();
  return [box.x + box.width / 2, box.y + box.height / 2];
}

export async function axe(page) {
  await page.evaluate(AXE);
  const found = await page.evaluate(() => window.axe.run(document, { runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"] }));
  return found.violations.map((v) => `${v.id}: ${v.nodes.slice(0, 3).map((n) => `${n.target} ${n.failureSummary}`).join(" | ")}`);
}

export const number = async (page, label, value) => {
  const field = page.getByLabel(label, { exact: true });
  await field.fill(value);
  await field.press("Enter");
};
export const wide = (page) => page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);

/** The components of every contributor are listed. */
export const unfold = async (page) => {
  for (const closed = page.locator(".budget .fold[aria-expanded=false]"); await closed.count(); ) await closed.first().click();
};

/** To whoever asked for the scenario, while it is played. */
export const tell = (what) => process.stdout.write(`${JSON.stringify(what)}\n`);

/** What the scenario that is asked for finds; its pages are closed, whatever happens. */
export async function play(scenarios, where, job) {
  [browser, asked, watched] = [where, job, { messages: [], strangers: [] }];
  try {
    return { ...(await scenarios[asked.scenario]()), watched };
  } finally {
    await Promise.all(browser.contexts().map((context) => context.close()));
  }
}
