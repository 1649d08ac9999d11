// Beads, pivots and beams moved in space, and a surface that beads touch.  See tests/service/test_workbench_space.py.
import { asked, axe, begun, current, drawn, drop, faded, newContext, state, take, wide } from "./page.mjs";

const scenarios = {};
const text = async (page) => (await state(page)).text;
const canvas = (page) => page.locator(".space .viewer-stage canvas");
const note = (page) => page.locator("#hands").innerText();

/** Where something is that can be taken hold of. */
async function find(page, words) {
  await canvas(page).scrollIntoViewIfNeeded();
  await drawn(page);
  const { x, y } = await canvas(page).boundingBox(), [right, down] = await page.evaluate((called) => window.workbench.handles().find((one) => one.words === called).at, words);
  return [x + right, y + down];
}

async function drag(page, from, by, key) {
  await page.mouse.move(...from);
  await page.mouse.down();
  if (key) await page.keyboard.down(key);
  for (const part of [0.3, 0.7, 1]) await page.mouse.move(from[0] + part * by[0], from[1] + part * by[1]);
  await drawn(page);
  await page.mouse.up();
  if (key) await page.keyboard.up(key);
  await current(page);
}

scenarios.space = async () => {
  const page = await begun(await newContext()), found = { before: await text(page), steps: [] }, count = async () => found.steps.push((await state(page)).position);
  await page.getByRole("button", { name: "In space", exact: true }).click();
  await canvas(page).waitFor();
  await drawn(page);
  await page.locator(".see .viewer-layers").waitFor();
  found.bead = "F7";
  let at = await find(page, found.bead);
  await drag(page, at, [14, -9]);
  found.after = await text(page);
  await count();
  await drag(page, await find(page, "pivot of the hand-eye"), [14, -9]);
  found.eye = await text(page);
  await count();
  await drag(page, await find(page, found.bead), [-3, -25], "Shift");
  found.along = await text(page);
  await count();
  at = await find(page, "pivot 1");
  await drag(page, at, [9, 6]);
  found.pivot = await text(page);
  await count();
  at = await find(page, "beam of AP");
  await drag(page, at, [-25, -10]);
  found.turned = await text(page);
  await count();
  await page.keyboard.press("ArrowUp");
  await current(page);
  found.tilted = await text(page);
  await count();
  await page.getByRole("button", { name: "Whole set-up" }).click();
  await drag(page, await find(page, "beam of AP"), [-25, -10]);
  found.far = await text(page);
  await count();
  await page.getByRole("button", { name: "Structure", exact: true }).click();
  await drop(page, "carrier.stl", Buffer.from(asked.stl, "base64"));
  await page.locator(".surface").waitFor();
  await drawn(page);
  at = await find(page, found.bead);
  await drag(page, at, [-10, 12]);
  found.snapped = await text(page);
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await page.keyboard.press("ArrowRight");
  await current(page);
  found.stepped = await text(page);
  await faded(page);
  found.axe = await axe(page);
  return found;
};

scenarios.keys = async () => {
  const page = await begun(await newContext({ hasTouch: true })), found = { texts: [await text(page)] };
  await canvas(page).waitFor();
  await drawn(page);
  await canvas(page).scrollIntoViewIfNeeded();
  await canvas(page).focus();
  await page.keyboard.press("n");
  await drawn(page);
  found.said = await note(page);
  await page.keyboard.press("ArrowUp");
  await current(page);
  found.texts.push(await text(page));
  const picture = () => canvas(page).evaluate((one) => one.toDataURL());
  await page.keyboard.press("Escape");
  await drawn(page);
  const still = await picture();
  await page.keyboard.press("ArrowUp");
  await drawn(page);
  found.turns = still !== (await picture()) && (await text(page)) === found.texts[1];
  found.wide = await wide(page);
  found.axe = await axe(page);
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

// A planned trajectory: down its axis, in every picture, and in the strip
scenarios.trajectory = async () => {
  const page = await begun(await newContext()), figure = page.locator(".trajectory"), numbers = (locator, names) => locator.evaluateAll((all, wanted) => all.map((one) => wanted.map((name) => Number(one.getAttribute(name)))), names);
  await figure.waitFor();
  const found = { begin: await numbers(figure.locator("circle.begin"), ["cx", "cy"]), end: await numbers(figure.locator("circle:not(.begin)"), ["cx", "cy"]), out: await figure.locator(".executed.out").count(), told: await figure.locator("figcaption").innerText() };
  found.rims = await figure.locator(".rim").evaluateAll((all) => all.map((one) => one.getAttribute("d").slice(1).split("L").map((at) => at.split(" ").map(Number))));
  found.planned = await page.locator("path.planned").count();
  found.beside = await page.locator(".others span").evaluateAll((all) => all.map((one) => [one.firstChild.textContent, one.lastElementChild.textContent]));
  found.p95 = await page.locator(".numbers > div").first().innerText();
  found.blame = await page.locator(".blame").innerText();
  await faded(page);
  found.axe = await axe(page);
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

// A design names its surface by file: refused until that is dropped.  Another is optimised with its beads on what was dropped
scenarios.surface = async () => {
  const page = await begun(await newContext()), found = {}, stl = Buffer.from(asked.stl, "base64");
  await take(page, asked.named);
  await page.locator(".verdict.refused").waitFor();
  found.refused = await page.locator(".verdict").innerText();
  await drop(page, "part.stl", stl);
  await current(page);
  found.named = await text(page);
  await page.keyboard.press("Control+z");
  await page.getByLabel("Optimise puts beads").selectOption("on its outside");
  await page.getByRole("button", { name: "Optimise this design" }).click();
  await page.getByRole("button", { name: /^Take the optimum/ }).click();
  found.taken = await text(page);
  await page.locator(".run").first().waitFor();
  found.title = await page.locator(".run strong").first().innerText();
  await current(page);
  found.basis = await page.locator("section.verdict").getAttribute("data-basis");
  found.axe = await axe(page);
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

export default scenarios;
