// The page without a browser: its own sources, bundled here, in a document of a few lines, before a service of a table.
// node workbench_in_node.mjs MODULES SOURCES: MODULES/node_modules has the page's packages; a job as JSON on stdin.
// See tests/service/test_workbench_kinds.py.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const [modules, sources] = process.argv.slice(2);
const { rolldown } = await import(pathToFileURL(createRequire(`${modules}/package.json`).resolve("rolldown")).href);
const job = JSON.parse(readFileSync(0, "utf8"));

// --- a document -------------------------------------------------------------------------------------------------------

class Node_ {
  childNodes = [];
  parentNode = null;
  attributes = [];
  style = {};
  constructor(nodeType, localName, namespaceURI) { Object.assign(this, { nodeType, localName, nodeName: localName, namespaceURI, ownerDocument: globalThis.document }); }
  get firstChild() { return this.childNodes[0] ?? null; }
  get nextSibling() { return this.parentNode?.childNodes[this.parentNode.childNodes.indexOf(this) + 1] ?? null; }
  insertBefore(node, before) {
    node.parentNode?.removeChild(node);
    this.childNodes.splice(before ? this.childNodes.indexOf(before) : this.childNodes.length, 0, node);
    node.parentNode = this;
    return node;
  }
  appendChild(node) { return this.insertBefore(node, null); }
  removeChild(node) { this.childNodes = this.childNodes.filter((each) => each !== node); node.parentNode = null; return node; }
  remove() { this.parentNode?.removeChild(this); }
  replaceChildren() { this.childNodes = []; }
  contains(other) { return other === this || this.childNodes.some((child) => child.contains(other)); }
  setAttribute(name, value) { this.removeAttribute(name); this.attributes.push({ name, value: String(value) }); }
  removeAttribute(name) { this.attributes = this.attributes.filter((each) => each.name !== name); }
  getAttribute(name) { return this.attributes.find((each) => each.name === name)?.value ?? null; }
  addEventListener() {}
  removeEventListener() {}
  querySelectorAll() { return []; }
  querySelector() { return null; }
  getBoundingClientRect() { return { height: 0, left: 0, width: 0, top: 0, bottom: 0 }; }
}
const storage = () => { const kept = {}; return Object.assign(Object.create({ getItem: (k) => kept[k] ?? null, setItem: (k, v) => { kept[k] = String(v); }, removeItem: (k) => { delete kept[k]; } }), {}); };
let pending = 0;
const timer = (act) => { pending += 1; let on = true; const id = setImmediate(() => { if (on) { pending -= 1; on = false; act(); } }); return { id, stop: () => { if (on) { pending -= 1; on = false; } } }; };
const document_ = Object.assign(new Node_(9, "#document"), {
  createElement: (name) => new Node_(1, name), createElementNS: (space, name) => new Node_(1, name, space), createTextNode: (data) => Object.assign(new Node_(3, "#text"), { data }),
  documentElement: new Node_(1, "html"), activeElement: null,
});
Object.assign(globalThis, {
  document: document_, window: globalThis, location: new URL(job.page ?? "http://here/"), history: { replaceState() {} }, localStorage: storage(), sessionStorage: storage(),
  setTimeout: timer, clearTimeout: (t) => t?.stop?.(), setInterval: () => 0, clearInterval() {}, requestAnimationFrame: timer, cancelAnimationFrame: (t) => t?.stop?.(), addEventListener() {}, removeEventListener() {}, scrollTo() {}, innerHeight: 800, innerWidth: 1280,
  ResizeObserver: class { observe() {} disconnect() {} }, DOMParser: class { parseFromString() { return document_; } },
});

// --- the page ---------------------------------------------------------------------------------------------------------

const NAMES = ["acts", "advice", "api", "jobs", "readings", "state", "parts/Contributors", "parts/Files", "parts/Form", "parts/Review", "parts/Runs", "parts/Verdict"];
const entry = [...NAMES.map((name) => `export * as ${name.replace("parts/", "")} from ${JSON.stringify(`${sources}/${name}`)};`), 'export { h, render } from "preact";'].join("\n");
const bundle = await rolldown({
  input: "entry", cwd: sources, logLevel: "silent", transform: { jsx: { runtime: "automatic", importSource: "preact" } },
  resolve: { modules: [`${modules}/node_modules`], extensions: [".ts", ".tsx", ".js"] },
  plugins: [{ name: "entry", resolveId: (id) => (id === "entry" ? id : null), load: (id) => (id === "entry" ? entry : null) }],
});
const { output } = await bundle.generate({ format: "esm", inlineDynamicImports: true });
const page = await import(`data:text/javascript;base64,${Buffer.from(output[0].code).toString("base64")}`);
const { acts, api, jobs, state, Contributors, Files, Form, Review, Runs, Verdict, h, render } = page;

// --- a service of a table -----------------------------------------------------------------------------------------------

const sorted = (value) => Array.isArray(value) ? value.map(sorted) : value && typeof value === "object" ? Object.fromEntries(Object.keys(value).sort().map((key) => [key, sorted(value[key])])) : value;
const same = (value) => JSON.stringify(sorted(value));
let states = []; // of the design that is looked at: {design, text, score, verification}
const answers = (status, body) => Response.json(body, { status });
const find = ({ review, ...design }) => states.findIndex((each) => same(each.design) === same(design));
const jobOf = (id) => ({ id, kind: "report", state: "succeeded", created_at: "2026-01-01T00:00:00Z", design_name: "", progress: { fraction: 1, note: "", eta_seconds: null }, result_sha256: id, problem: null, links: { report: `/v1/results/${id}/report` } });
globalThis.fetch = async (address, { method, body }) => {
  pending += 1;
  await null;
  pending -= 1;
  const path = new URL(address).pathname, given = typeof body === "string" ? JSON.parse(body) : null, k = given?.design ? find(given.design) : -1;
  if (path === "/v1/scores") return k < 0 ? answers(422, { errors: [] }) : answers(200, states[k].score);
  if (path === "/v1/scores/batch") {
    const rows = Object.values(given.table)[0].length, [check] = states[k].score.verdict.checks;
    return answers(200, { columns: { [`value:${check.requirement}:${check.target}`]: Array(rows).fill(job.advised), verdict: Array(rows).fill("pass") } });
  }
  if (path === "/v1/reports") return answers(202, jobOf(`${k}`));
  if (path.startsWith("/v1/jobs/")) return answers(200, jobOf(path.split("/").pop()));
  if (path.startsWith("/v1/results/")) { const { score, verification, distributions } = states[Number(path.split("/").pop())]; return answers(200, { schema: "tailstack/report/1", score, verification, distributions, allowances: [], provenance: score.provenance }); }
  return answers(404, { errors: [] });
};
async function settled() {
  for (let quiet = 0; quiet < 6; quiet += 1) {
    await new Promise((done) => setImmediate(done));
    if (pending) quiet = 0;
  }
}

// --- what is on it --------------------------------------------------------------------------------------------------------

const BLOCKS = /^(p|td|th|dt|dd|div|li|caption|summary|figcaption|text|title|button|option|span|tr|path|g|svg)$/;
/** Every line with the kind that its place says, and what is said in it. */
function linesOf(node, kind = null, found = []) {
  const own = node.getAttribute?.("data-kind") ?? kind, said = ["aria-label", "title"].map((name) => node.getAttribute?.(name)).filter(Boolean);
  for (const text of said) found.push({ kind: own, text, in: node.localName });
  const inline = (each) => (each.nodeType === 3 ? each.data : /^(strong|output|em|sub)$/.test(each.localName) || (each.localName === "span" && !each.getAttribute("data-kind")) ? each.childNodes.map(inline).join("") : "");
  const text = node.nodeType === 1 ? node.childNodes.map(inline).join("") : "";
  if (text.trim() && !/^(span|strong|output)$/.test(node.localName)) found.push({ kind: own, text, in: node.localName });
  else if (text.trim() && node.getAttribute?.("data-kind")) found.push({ kind: own, text, in: node.localName });
  for (const child of node.childNodes) if (child.nodeType === 1) linesOf(child, own, found);
  return found;
}

const PARTS = [Verdict.Verdict, Verdict.Requirements, Contributors.Contributors, Review.Versions, Runs.Runs];
async function walk(each) {
  states = each.states;
  const root = document_.createElement("div"), seen = [];
  const look = async (what) => {
    await settled();
    render(h("div", null, PARTS.map((Part, k) => h(Part, { key: k }))), root);
    await settled();
    seen.push({ what, current: api.current.value, basis: page.readings.shown.value?.kind ?? null, advice: Boolean(page.advice.advised.value?.step), lines: linesOf(root) });
  };
  const [base, dragged, variant] = states;
  state.open(base.text, "Open");
  await look("opened");
  state.keepVersion();
  await acts.verify();
  await look("verified");
  if (variant) await change();
  for (const { name } of state.versions.value) state.removeVersion(name);
  for (const { id } of jobs.runs.value) jobs.forget(id);
  jobs.results.value = {};
  render(null, root);
  return seen;

  async function change() {
    state.preview(each.drag);
    await look("being dragged");
    state.finishGesture("Move");
    await look("dragged");
    await acts.verify();
    await look("dragged and verified");
    state.keepVersion();
    state.undo();
    await look("undone");
    state.commit(variant.text, "Variant");
    await look("variant");
    await acts.verify();
    await look("variant verified");
    state.undo();
    await look("undone again");
    state.redo();
    await look("done again");
  }
}

const found = {};
if (job.walks) { found.walks = []; for (const each of job.walks) found.walks.push(await walk(each)); }
if (job.choices) found.choices = job.choices.map(({ node, path, chosen }) => Form.limitOf(node, path, chosen));
if (job.addresses) found.addresses = job.addresses.map(([at, path]) => { globalThis.location = new URL(at); return api.addressOf(path); });
if (job.lists) { Form.schema.value = job.schema; found.lists = job.lists.map(({ node, value }) => Form.another(node, value)); }
if (job.history) {
  state.open("a: 0", "Open");
  found.history = job.history.map((length, k) => { state.commit(`a: ${k + 1} #`.padEnd(length, "#"), "Write"); return state.steps.value.map(({ text }) => text.length); });
}
if (job.tables) found.tables = job.tables.map((text) => { const made = Files.withHeader(text); return made && { first: made.first, labels: made.labels, mm: made.of("mm") }; });
process.stdout.write(JSON.stringify(found), () => process.exit(0));
