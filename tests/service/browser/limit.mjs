// The limit as a handle: how it is dragged.  See tests/service/test_workbench_limit.py.
import { asked, axe, begun, centre, drawn, newContext, number, state, tell, timeless, unfold, unhurried, wide } from "./page.mjs";

const scenarios = {}, handle = (page, of) => page.locator(`.handle.${of}`), words = (page) => page.getByTestId("pulled").innerText();
const numberOf = async (page, of, what = "aria-valuenow") => Number(await handle(page, of).getAttribute(what));
const settled = (page) => page.waitForFunction(() => document.querySelector(".rail")?.dataset.waits === "false" && window.workbench.state().current && !window.workbench.state().busy, null, { polling: 20 });

/** Drag a handle to a part of the scale, in steps; what was seen on the way. */
async function drag(page, of, to, steps = 12) {
  const [x, y] = await centre(handle(page, of)), ruler = await page.locator(".ruler").boundingBox(), end = ruler.x + to * ruler.width;
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (let k = 1; k <= steps; k += 1) {
    await page.mouse.move(x + ((end - x) * k) / steps, y);
    await drawn(page);
  }
}

const lock = async (page, names) => {
  if (names.length) await unfold(page);
  for (const name of names) await page.getByRole("button", { name: `Lock ${name}`, exact: true }).click();
};
/** What the page shows and holds. */
const told = async (page) => {
  const { text, steps, position, current } = await state(page);
  return { text, steps, position, current, words: await words(page), limit: await numberOf(page, "limit"), value: await numberOf(page, "value"), p95: await page.locator("#p95").innerText() };
};
const offered = (page) => page.waitForFunction(() => /\d/.test(document.querySelector(".acts .keep").textContent) || document.querySelector(".rail.outdated"), null, { polling: 50 });

// A handle dragged, held, let go, and taken back; then with keys, given up, and typed
scenarios.drag = async () => {
  const page = await begun(await unhurried(asked.context ?? {})), found = {};
  await offered(page);
  await lock(page, asked.lock ?? []);
  await offered(page);
  found.before = await told(page);
  await page.locator(`.handle.${asked.of}`).click();
  found.clicked = await told(page);
  await drag(page, asked.of, asked.to);
  await settled(page);
  found.held = await told(page);
  found.wide = await wide(page);
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await page.mouse.up();
  await settled(page);
  found.after = await told(page);
  if (asked.axe) found.axe = await axe(page);
  await page.keyboard.press("Control+z");
  await settled(page);
  found.undone = await told(page);
  return found;
};

scenarios.keys = async () => {
  const page = await begun(await timeless(await unhurried())), found = {};
  await offered(page);
  found.before = await told(page);
  await handle(page, "limit").focus();
  for (let k = 0; k < 4; k += 1) await page.keyboard.press("ArrowLeft");
  await settled(page);
  found.left = await told(page);
  await page.keyboard.press("Home");
  await settled(page);
  found.home = await told(page);
  await page.keyboard.press("Control+z");
  await settled(page);
  await drag(page, "limit", 0.5);
  await page.keyboard.press("Escape");
  await page.mouse.up();
  await settled(page);
  found.given = await told(page);
  const keep = async (limit) => {
    const { position } = await state(page);
    await number(page, "limit of tip-accuracy, mm", limit);
    await page.waitForFunction((count) => window.workbench.state().position > count, position);
    await settled(page);
    await page.locator(".acts .keep").click();
  };
  await keep("0,9");
  await page.waitForFunction((count) => window.workbench.state().position > count + 1, found.given.position);
  await settled(page);
  found.typed = await told(page);
  await keep("0.2");
  await page.locator("[data-testid=pulled].bad").waitFor();
  found.beyond = await told(page);
  return found;
};

// By a finger
scenarios.touch = async () => {
  const context = await unhurried({ hasTouch: true, isMobile: true }), page = await begun(context), session = await context.newCDPSession(page), found = {};
  await offered(page);
  const [x, y] = await centre(handle(page, "limit")), ruler = await page.locator(".ruler").boundingBox(), end = ruler.x + asked.to * ruler.width, top = await page.evaluate(() => scrollY);
  const touch = (type, at) => session.send("Input.dispatchTouchEvent", { type, touchPoints: at === undefined ? [] : [{ x: at, y }] });
  await touch("touchStart", x);
  for (let k = 1; k <= 8; k += 1) await touch("touchMove", x + ((end - x) * k) / 8);
  await touch("touchEnd");
  await settled(page);
  found.after = await told(page);
  found.wide = await wide(page);
  found.scrolled = (await page.evaluate(() => scrollY)) - top;
  found.sizes = await page.locator(".handle").evaluateAll((all) => all.map((one) => [one.offsetWidth, one.offsetHeight]));
  found.axe = await axe(page);
  return found;
};

// The crossing of a curve under its slider: dragged, given up, let go while the service is away, moved by keys, pressed
scenarios.curve = async () => {
  const context = await timeless(await newContext(asked.finger ? { hasTouch: true, isMobile: true } : {})), page = await begun(context), found = {}, dot = page.locator(`.slide:has([data-pointer="${asked.pointer}"]) .crossing`);
  await page.getByRole("button", { name: "Curves" }).click();
  const rested = async () => { await settled(page); await dot.waitFor(); await page.locator(".curve:not(.old)").first().waitFor(); };
  const read = async () => { await rested(); return { ...(await told(page)), limit: Number(await dot.getAttribute("aria-valuenow")), says: await dot.getAttribute("aria-valuetext") }; };
  const session = asked.finger && await context.newCDPSession(page);
  const pull = async () => {
    await rested();
    const [x, y] = await centre(dot), places = Array.from({ length: 6 }, (_, k) => x + ((k + 1) * asked.by) / 6), touch = (type, at) => session.send("Input.dispatchTouchEvent", { type, touchPoints: at === undefined ? [] : [{ x: at, y }] });
    if (!session) await page.mouse.move(x, y);
    await (session ? touch("touchStart", x) : page.mouse.down());
    for (const at of places) {
      await (session ? touch("touchMove", at) : page.mouse.move(at, y));
      await drawn(page);
    }
    return () => (session ? touch("touchEnd") : page.mouse.up());
  };
  found.before = await read();
  let drop = await pull();
  await settled(page);
  found.held = { says: await dot.getAttribute("aria-valuetext"), text: (await state(page)).text, wide: await wide(page) };
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await drop();
  await page.waitForFunction(() => window.workbench.state().position === 1);
  found.after = await read();
  found.axe = await axe(page);
  if (asked.finger) return found;
  await page.keyboard.press("Control+z");
  drop = await pull();
  await page.keyboard.press("Escape");
  await drop();
  found.given = await read();
  drop = await pull();
  await page.route("**/v1/scores/batch", (route) => route.abort());
  await drop();
  await page.locator(".message.bad").waitFor();
  await page.unroute("**/v1/scores/batch");
  found.away = (await state(page)).text;
  await rested();
  await dot.focus();
  for (const key of ["ArrowRight", "ArrowRight", "Alt+ArrowRight"]) await page.keyboard.press(key);
  await page.waitForFunction(() => window.workbench.state().position === 1);
  found.keys = await read();
  found.focus = await page.evaluate(() => document.activeElement.className);
  await page.keyboard.press("Home");
  await page.waitForFunction((was) => window.workbench.state().text !== was, found.keys.text);
  found.home = await read();
  return found;
};

// The service is killed while the hand holds
scenarios.killed = async () => {
  const page = await begun(await unhurried()), before = (await state(page)).text;
  await offered(page);
  await drag(page, "limit", 0.5);
  await settled(page);
  tell({ said: "kill" });
  await page.waitForFunction(() => fetch("health/live").then(() => false, () => true), null, { polling: 100 });
  const { x, y } = await handle(page, "limit").boundingBox();
  await page.mouse.move(x - 20, y + 8);
  await page.waitForFunction(() => !window.workbench.state().current, null, { polling: 20 });
  await page.locator("#verdict.refused").waitFor();
  const found = { shown: await page.locator("#verdict").getAttribute("data-current"), words: await words(page), same: (await state(page)).text === before };
  await page.mouse.up();
  return { ...found, steps: (await state(page)).position };
};

// What cannot be dragged says why, and asks nothing
scenarios.barred = async () => {
  const page = await begun(await unhurried()), asks = [];
  page.on("request", (request) => request.url().includes("/v1/allocations") && asks.push(request.url()));
  await drag(page, "limit", 0.2);
  await page.mouse.up();
  return { ...(await told(page)), asks: asks.length, disabled: await page.locator(".acts .keep").isDisabled(), locks: await page.locator("button.lock").count() };
};

export default scenarios;
