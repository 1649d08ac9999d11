// Several beads at once, what moving keeps, and beads moved in space.  See tests/service/test_workbench_arranged.py.
import { asked, axe, bead, begun, centre, current, drawn, faded, newContext, state, wide } from "./page.mjs";

const scenarios = {}, FRONT = "Front (x, z)";
const beads = async (page) => (await state(page)).text;
const steps = async (page) => (await state(page)).position;
const chosen = (page) => page.locator(".beads tr.chosen th").allInnerTexts();
const press = (page, name) => page.locator(".arrange").getByRole("button", { name, exact: true }).click();

async function drag(page, from, by, ...keys) {
  for (const key of keys) await page.keyboard.down(key);
  await page.mouse.move(...from);
  await page.mouse.down();
  for (const part of [0.3, 0.7, 1]) await page.mouse.move(from[0] + part * by[0], from[1] + part * by[1]);
  await page.mouse.up();
  for (const key of keys) await page.keyboard.up(key);
  await current(page);
}

// Chosen with Shift, by a frame, with Ctrl+A; moved together, one step each; locks, spacing; mirrored, turned, on a circle
scenarios.arrange = async () => {
  const page = await begun(await newContext()), found = { before: await beads(page) };
  await page.mouse.click(...(await centre(bead(page, "F1"))));
  await page.keyboard.down("Shift");
  await page.mouse.click(...(await centre(bead(page, "F5"))));
  await page.keyboard.up("Shift");
  found.shift = await chosen(page);
  await drag(page, await centre(bead(page, "F5")), [-9, 6]);
  found.together = [await beads(page), await steps(page)];
  const front = page.getByRole("application", { name: FRONT });
  await page.getByRole("button", { name: "Arrange 2" }).click();
  await page.locator(".arrange").waitFor();
  await faded(page);
  found.axe = asked.axe ? await axe(page) : [];
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await page.keyboard.press("Control+z");
  await front.focus();
  await page.keyboard.press("Escape");
  found.escaped = await chosen(page);
  const [x, y] = await centre(bead(page, "F7")); // one corner of the front, and a bead behind it
  await drag(page, [x - 30, y - 20], [60, 40], "Control");
  found.framed = await chosen(page);
  await page.keyboard.press("Control+a");
  found.all = (await chosen(page)).length;
  await press(page, "Lock z");
  await front.focus();
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("ArrowRight");
  await current(page);
  found.locked = await beads(page);
  await page.keyboard.press("Control+z");
  await press(page, "Lock z");
  await page.mouse.click(...(await centre(bead(page, "F9"))));
  const [from, to] = [await centre(bead(page, "F9")), await centre(bead(page, "F12"))];
  await drag(page, from, [to[0] - from[0], to[1] - from[1]]);
  found.spaced = await beads(page);
  await page.keyboard.press("Control+z");
  await page.mouse.click(...(await centre(bead(page, "F9"))));
  await press(page, "Mirror in x = 0");
  await current(page);
  found.mirrored = await beads(page);
  await page.keyboard.press("Control+z");
  await page.getByRole("combobox", { name: "Axis" }).selectOption("z");
  await press(page, "Copies");
  await press(page, "Turn about z");
  await current(page);
  found.copied = [await beads(page), await chosen(page)];
  return found;
};

// At the width of a phone, by fingers alone
scenarios.finger = async () => {
  const page = await begun(await newContext({ hasTouch: true })), found = { before: await beads(page) };
  await page.getByRole("button", { name: "Arrange" }).click();
  await press(page, "Several");
  for (const label of ["F9", "F10"]) await page.touchscreen.tap(...(await centre(bead(page, label))));
  await drawn(page);
  found.chosen = await chosen(page);
  found.wide = await wide(page);
  found.axe = await axe(page);
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

export default scenarios;
