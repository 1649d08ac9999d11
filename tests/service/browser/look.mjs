// Opens pages in Chromium and says what happened.  A page that is asked for:
// {url, width, height, scheme, media, script, axe, keys, shot, viewer}; see tests/service/browsing.py.
import { asked, AXE, browser } from "./page.mjs";

// Of what axe-core calls best practice: regions that a screen reader lists must be told apart by their names.
const BEYOND = { "landmark-unique": { enabled: true } };
const TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"];
// Colours are counted in a copy: reading the viewer's own canvas would change how the browser keeps it.
const CANVAS = `(() => [...document.querySelectorAll(".viewer canvas")].map((canvas) => {
  const copy = document.createElement("canvas");
  copy.width = canvas.width; copy.height = canvas.height;
  const context = copy.getContext("2d", {willReadFrequently: true});
  context.drawImage(canvas, 0, 0);
  const {data} = context.getImageData(0, 0, copy.width, copy.height);
  const seen = new Map();
  let hash = 17;
  for (let k = 0; k < data.length; k += 4) {
    const colour = (data[k] << 16) | (data[k + 1] << 8) | data[k + 2];
    seen.set(colour, (seen.get(colour) || 0) + 1);
    hash = (Math.imul(hash, 31) + colour) | 0;
  }
  const ground = Math.max(...seen.values());
  return {width: canvas.width, height: canvas.height, colours: seen.size, drawn: 1 - 4 * ground / data.length, hash};
}))()`;

const FRAMES = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))";

async function looked(job) {
  const context = await browser.newContext({
    viewport: { width: job.width ?? 1280, height: job.height ?? 900 }, colorScheme: job.scheme ?? "light",
    javaScriptEnabled: job.script ?? true, reducedMotion: "reduce", serviceWorkers: "block",
  });
  context.setDefaultTimeout(asked.limit);
  const page = await context.newPage();
  const found = { messages: [], requests: [], failed: [], violations: [], canvases: [] };
  page.on("console", (said) => found.messages.push(`${said.type()}: ${said.text()}`));
  page.on("pageerror", (error) => found.messages.push(`error: ${error.message}`));
  page.on("request", (request) => found.requests.push(request.url()));
  page.on("requestfailed", (request) => found.failed.push(request.url()));
  try {
    const answer = await page.goto(job.url, { waitUntil: "load" });
    found.status = answer?.status() ?? 0;
    found.headers = answer?.headers() ?? {};
    if (job.media) await page.emulateMedia({ media: job.media });
    const session = await context.newCDPSession(page);
    // by the debugger, which the page's own policy does not bind: the page stays as its readers get it
    const ask = async (expression) => {
      const said = await session.send("Runtime.evaluate", {
        expression, awaitPromise: true, returnByValue: true, allowUnsafeEvalBlockedByCSP: true,
      });
      if (said.exceptionDetails) throw new Error(JSON.stringify(said.exceptionDetails).slice(0, 2000));
      return said.result.value;
    };
    if (job.script !== false) {
      found.width = await ask("document.documentElement.scrollWidth");
      found.title = await ask("document.title");
      for (const expression of job.ask ?? []) (found.answers ??= []).push(await ask(expression));
      if (job.viewer) {
        await ask(FRAMES); // a page is loaded before its first frame is drawn
        found.canvases.push(await ask(CANVAS));
        for (const key of found.canvases[0].length ? job.keys ?? [] : []) {
          await page.locator(".viewer canvas").first().focus();
          await page.keyboard.press(key);
          await ask(FRAMES);
          found.canvases.push(await ask(CANVAS));
        }
      }
      if (job.axe) {
        await ask(`${AXE}; true`);
        const run = `axe.run(document, {runOnly: {type: "tag", values: ${JSON.stringify(TAGS)}}, rules: ${JSON.stringify(BEYOND)}, resultTypes: ["violations"]})`;
        found.violations = await ask(
          `${run}.then((r) => r.violations.map((v) => ({id: v.id, help: v.help, nodes: v.nodes.slice(0, 5).map((n) => n.html.slice(0, 200) + " | " + n.failureSummary)})))`,
        );
      }
    }
    if (job.shot) await page.screenshot({ path: job.shot, fullPage: job.full ?? true });
    if (job.pdf) await page.pdf({ path: job.pdf, preferCSSPageSize: true, printBackground: true });
  } finally {
    await context.close();
  }
  return found;
}

async function look() {
  const results = [];
  for (const job of asked.jobs) results.push(await looked(job));
  return { results };
}

export default { look };
