// Where a bead would be better: what the pictures draw of it.  See tests/service/test_workbench_places.py.
import { asked, axe, bead, begun, centre, current, drawn, faded, newContext, state } from "./page.mjs";

const scenarios = {}, FRONT = "Front (x, z)", AP = "AP: X-ray image";
const figure = (page, name) => page.locator("figure.picture", { has: page.locator("figcaption", { hasText: name }) });
const box = (page, name) => figure(page, name).locator("svg").evaluate((svg) => svg.getAttribute("viewBox").split(" ").map(Number));

/** The numbers of paths, each with what it is of. */
const paths = (page, name, selector, of) => figure(page, name).locator(selector).evaluateAll((all, key) => all.map((one) => [one.closest(`[${key}]`).getAttribute(key), one.getAttribute("d").match(/-?[\d.]+(e-?\d+)?/g).map(Number)]), of);

// What is there fills an image; wheel, keys and buttons; a bead that is pointed at, wherever that is, is marked everywhere
scenarios.zoom = async () => {
  const page = await begun(await newContext()), found = {};
  const filled = () => figure(page, AP).locator("svg").evaluate((svg) => { // the part of its height from the highest bead or target to the lowest
    const at = [...svg.querySelectorAll(".mark, .target path")].map((one) => { const { y, height } = one.getBoundingClientRect(); return y + height / 2; });
    return (Math.max(...at) - Math.min(...at)) / svg.clientHeight;
  });
  found.fit = await filled();
  await figure(page, AP).getByRole("button", { name: "Whole image" }).click();
  found.whole = await filled();
  await figure(page, AP).getByRole("button", { name: "Fit" }).click();
  const [x, y] = await centre(bead(page, "F5", AP)), place = async () => [(await bead(page, "F5", AP).boundingBox()).x, (await box(page, AP))[2]];
  await page.mouse.move(x, y);
  await drawn(page);
  const marked = (label) => page.evaluate((name) => [...document.querySelectorAll(".bead.over, .beads tr.over th")].map((one) => one.dataset.bead ?? one.textContent).filter((one) => one === name).length, label);
  const scene = () => page.locator(".space canvas").first().evaluate((canvas) => canvas.toDataURL());
  const ringed = await scene();
  found.pointed = await marked("F5");
  const before = await place();
  await page.mouse.wheel(0, -120); // the page's, as the picture has no focus
  found.unfocused = await place();
  await page.mouse.click(x, y);
  await page.mouse.wheel(0, -120);
  await drawn(page);
  found.wheel = [before, await place()];
  await page.keyboard.press("-");
  found.key = (await box(page, AP))[2];
  await page.keyboard.press("0");
  found.again = await filled();
  await page.locator(".beads tbody tr", { hasText: "F3" }).first().hover();
  await drawn(page);
  found.row = await marked("F3");
  found.space = ringed !== (await scene());
  await page.locator(".space canvas").first().scrollIntoViewIfNeeded();
  const canvas = await page.locator(".space canvas").first().boundingBox();
  found.seen = [];
  for (let k = 0; k < 900 && !found.seen.length; k += 1) {
    await page.mouse.move(canvas.x + ((k % 30) + 0.5) * canvas.width / 30, canvas.y + (Math.floor(k / 30) + 0.5) * canvas.height / 30);
    found.seen = await page.locator(".beads tr.over th").allInnerTexts();
  }
  found.steps = (await state(page)).position;
  return found;
};

// How near the layout is to the best that any could be, and where beads tell most: both stand still in a drag
scenarios.best = async () => {
  const page = await begun(await newContext()), found = {}, words = page.getByTestId("best");
  let asked_ = 0;
  page.on("request", (request) => request.url().endsWith("/v1/validations") && (asked_ += 1));
  await page.waitForFunction(() => document.querySelector("[data-testid=best]")?.textContent.trim());
  found.rest = [await words.innerText(), await words.getAttribute("title")];
  found.hidden = await page.locator(".worthy circle").count();
  await page.getByRole("button", { name: "Where beads tell most" }).click();
  found.places = await figure(page, FRONT).locator(".worthy circle").evaluateAll((all) => all.map((one) => ["cx", "cy", "r"].map((name) => Number(one.getAttribute(name)))));
  found.layer = await page.getByLabel("Where fiducials tell most").isChecked();
  const [x, y] = await centre(bead(page, asked.label));
  const before = asked_;
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 25, y - 20, { steps: 4 });
  await page.waitForFunction((was) => document.querySelector("[data-testid=best]").textContent !== was, found.rest[0]);
  found.dragged = await words.innerText();
  await page.mouse.up();
  await current(page);
  found.asked = asked_ - before;
  if (asked.shot) await page.screenshot({ path: asked.shot, fullPage: true });
  return found;
};

// Arrows, what losing a bead costs, and contours round the one that is chosen, then round the one that is held
scenarios.places = async () => {
  const page = await begun(await newContext()), found = {}, label = asked.label;
  await page.locator(".arrows path").first().waitFor();
  found.arrows = await paths(page, FRONT, ".arrows path", "data-arrow");
  found.legend = await page.locator(".places").innerText();
  found.fills = await figure(page, FRONT).locator(".bead").evaluateAll((all) => all.map((one) => [one.dataset.bead, one.querySelector(".mark").style.fill]));
  await page.mouse.move(...(await centre(bead(page, label))));
  found.title = await figure(page, FRONT).locator("svg > title").textContent();
  await page.mouse.down();
  await page.mouse.up();
  const shown = figure(page, FRONT).locator(".contours:not(.coarse)");
  await shown.waitFor();
  const look = async () => ({ levels: await paths(page, FRONT, ".level path", "data-level"), refusals: await shown.locator(".refusal").evaluateAll((all) => all.map((one) => [one.textContent, Number(one.getAttribute("x")) + one.getAttribute("width") / 2, Number(one.getAttribute("y")) + one.getAttribute("height") / 2])) });
  found.rest = await look();
  await faded(page);
  if (asked.axe) found.axe = await axe(page);
  const [x, y] = await centre(bead(page, label));
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 12, y + 8, { steps: 4 });
  await drawn(page);
  found.held = [await page.locator(".arrows path").count(), await shown.locator(".level").count()]; // arrows are of the design before
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await page.keyboard.press("Escape");
  await page.mouse.up();
  await current(page);
  await page.getByRole("button", { name: "Contours", exact: true }).click();
  await page.getByRole("button", { name: "Where to drop" }).click();
  await figure(page, FRONT).locator("svg").focus();
  await drawn(page);
  found.hidden = [await page.locator(".contours").count(), await page.locator(".arrows path").count()];
  return found;
};

export default scenarios;
