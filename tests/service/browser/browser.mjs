// One browser for all pages of a test process, and all that is done in it.  Lines of JSON on stdin: {executable, sandbox, limit},
// then one job after the other, {script, scenario, limit, ...}.  Lines of JSON on stdout: for each job {found} or {error},
// and before it {said} as often as its scenario tells something.  It ends when stdin does, so with whoever started it.
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { play, tell } from "./page.mjs";

const FLAGS = [
  "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync",
];
const SCENARIO_LIMITS = 3; // of one wait, for the whole of a scenario, which waits again and again

async function answer(browser, job) {
  let late;
  const tooLate = new Promise((_, fail) => { late = setTimeout(() => fail(new Error(`${job.scenario} did not end`)), SCENARIO_LIMITS * job.limit); });
  try {
    const { default: scenarios } = await import(`./${job.script}`);
    tell({ found: await Promise.race([play(scenarios, browser, job), tooLate]) });
  } catch (error) {
    tell({ error: error.stack });
  } finally {
    clearTimeout(late);
  }
}

const lines = createInterface({ input: process.stdin });
let browser, last;
lines.on("line", (line) => {
  const said = JSON.parse(line);
  if (browser) last = Promise.all([browser, last]).then(([ready]) => answer(ready, said));
  else browser = chromium.launch({ executablePath: said.executable, chromiumSandbox: said.sandbox, args: FLAGS, timeout: said.limit });
});
lines.once("close", async () => {
  await (await browser)?.close();
  process.exit();
});
