// How a design comes in and goes out: gallery, files, the link, the sheet for a supplier, "copy as".

import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { key, pathOf, readRefusal, send, unreachable } from "../api";
import { base64, canUndo, design, differences, edit, first, type Json, leaveFirst, linked, linkOf, LONGEST_LINK, open, parse, say, settled, text, valueAt, whole } from "../state";
import { firstDesign } from "../first";
import { rounded } from "../geometry";
import { readNumber, VERDICTS } from "../words";
import { CArmChoice, CArmNote, unread, wishes } from "./CArm";
import { beginMinute } from "./Minute";
import { fileName, handOver, save } from "./Reports";

export const working = signal<string | null>(null); // what the page is busy with

const POINTS: Record<string, string> = { "mrk.json": "mrk.json", fcsv: "fcsv", csv: "csv", tsv: "csv", txt: "csv", dat: "csv", xlsx: "csv", xlsm: "csv", ods: "csv", step: "step", stp: "step", p21: "step" }; // by ending
const LARGEST: Record<string, number> = { step: 32 }; // MB of a file, otherwise 1, as the command reads; the service may read less

const SIGN = [128, 132] as const; // where an image says DICM
const HEADERS = 600_000, HEADER = 100_000; // bytes of all images, and of one, that are sent: pixels come last

/** Take what was dropped or chosen: images together, for each is a view of one design, and others one by one. */
export async function takeFiles(files: File[]): Promise<void> {
  asking.value = null; // what another file left open
  const empty = files.find(({ size }) => !size);
  if (empty) return void say(`${empty.name} is empty`, true);
  const are = await Promise.all(files.map(async (file) => /\.(dcm|dicom)$/i.test(file.name) || (await file.slice(...SIGN).text()) === "DICM"));
  const images = files.filter((_, k) => are[k]);
  if (images.length) await takeImages(images);
  for (const file of files.filter((_, k) => !are[k])) await takeFile(file);
}

/** What a file is added to: the design, unless the first page is shown, where one begins. */
const present = (): Json => (first.value ? null : design.value && settled.value);

/** The first views of the design as the headers of images say, or a first design about them. */
async function takeImages(files: File[]): Promise<void> {
  const names = files.map(({ name }) => name).join(", "), base = present();
  const [content, ...more] = await Promise.all(files.map(async (file) => base64(new Uint8Array(await file.slice(0, Math.min(HEADER, HEADERS / files.length)).arrayBuffer()))));
  const called = (words: string) => files.reduce((all, { name }, k) => all.replaceAll(k ? `more.${k}.dicom` : "content.dicom", name), words);
  const made = await convert(names, called, send("POST", "/v1/conversions", { format: "dicom", content, ...(more.length && { more }), ...(base && { base }) }));
  if (!made) return;
  if (base) edit(differences(base, parse(made.content).data), `Views of ${names}`);
  else begin(made.content, `Open ${names}`);
  assumes.value ||= !base;
  say(`${names}: ${files.length === 1 ? "a view is" : `${files.length} views are`} as the headers say. ${made.notes.slice(0, 5).map(called).join("; ")}`);
}

/** What a person at the page may have meant, where the service has a cure for one who meant what it looked for. */
const ALSO: Record<string, string> = { "no-ball": "if it is the surface of your part that you mean, export it as STL and drop that" };

/** What the service makes of a file; null where it refuses: that is said, unless ``asks`` has asked what was left open. */
async function convert(name: string, called: (words: string) => string, asked: Promise<Response>, asks?: (rule: string, detail: string) => Promise<boolean>): Promise<Json> {
  asking.value = null;
  working.value = `${name} is being read`;
  const response = await asked.catch(() => null).finally(() => (working.value = null));
  if (response?.ok) return response.json();
  if (!response) {
    say(`${name} was not read: the service does not answer. Drop it again once it does.`, true);
    return null;
  }
  const [{ rule, detail, hint, file, pointer }] = (await readRefusal(response)).errors, words = called(detail);
  const where = [file ? called(file) : name, ...pathOf(pointer).slice(1)].join(" › "), told = [words, hint, ALSO[rule]].filter(Boolean).join("; ");
  if (!(await asks?.(rule, words))) say(told.startsWith(where) ? told : `${where}: ${told}`, true);
  return null;
}

/** Take a file: a design is opened; points, and the balls of a STEP file, become the design's fiducials. */
async function takeFile(file: File): Promise<void> {
  if (/\.stl$/i.test(file.name)) return (await import("../carrier")).takeSurface(file);
  const ending = Object.keys(POINTS).find((e) => file.name.toLowerCase().endsWith(`.${e}`)), kind = ending ? POINTS[ending] : "design", most = LARGEST[kind] ?? 1;
  if (file.size > 1e6 * most) return void say(`${file.name} has ${Math.round(file.size / 1e6)} MB; of this kind, files of at most ${most} MB are read`, true);
  const named = filesOf(settled.value).filter((name) => name.split("/").pop() === file.name);
  if (named.length) return takeNamed(file, named);
  if (ending) return takePoints(file, kind);
  const content = decode(await file.arrayBuffer());
  if (/\.\w+$/.test(file.name) && !/\.(ya?ml|json)$/i.test(file.name) && (content === null || parse(content).errors.length)) return void say(`${file.name} is none of the files that are read here: a design (.yaml, .json), beads (.csv, .xlsx, .mrk.json, .fcsv, .step), the surface of a part (.stl), images of a C-arm (.dcm), or what the open design names`, true);
  if (content === null) return void say(`${file.name} is not UTF-8 text: save it as UTF-8`, true);
  if (/\.json$/i.test(file.name) && /"markups"\s*:/.test(content) && !/"fiducials"\s*:/.test(content)) return takePoints(file, "mrk.json"); // of 3D Slicer, whatever its name
  takeText(file.name, content, `Open ${file.name}`);
}

/** The files of text that a design names; surfaces and tables of spreadsheets have doors of their own. */
function filesOf(data: Json): string[] {
  if (!data || typeof data !== "object") return [];
  const own = typeof data.file === "string" && !/\.(stl|xlsx|xlsm|ods)$/i.test(data.file) ? [data.file] : [];
  return Object.entries(data).flatMap(([name, each]) => (/^(origin|target_origins)$/.test(name) ? [] : filesOf(each))).concat(own);
}

const given: Record<string, string> = {}; // of files that the design names: kept until all of them are here

/** A file that the design names, as the command reads it beside the design: what it holds takes the place of its name. */
async function takeNamed(file: File, names: string[]): Promise<void> {
  const content = decode(await file.arrayBuffer());
  if (content === null) return void say(`${file.name} is not UTF-8 text: save it as UTF-8`, true);
  for (const name of names) given[name] = content;
  const { optimise: _, ...base } = settled.value, all = filesOf(base), left = all.filter((name) => !(name in given));
  if (left.length) return void say(`${file.name} is kept. The design names ${left.join(", ")}, too: drop that as well.`);
  const files = Object.fromEntries(all.map((name) => [name, given[name]]));
  const made = await convert(file.name, (words) => words, send("POST", "/v1/conversions", { format: "json", to: "json", content: JSON.stringify(base), files }));
  if (!made) return;
  edit(differences(base, parse(made.content).data), `What ${all.join(", ")} ${all.length > 1 ? "hold" : "holds"}`);
  say(`What ${all.join(" and ")} ${all.length > 1 ? "hold" : "holds"} is in the design, in place of the ${all.length > 1 ? "names" : "name"}.`);
}

/** Open a design; what was pressed for it is gone, or of no more use: what comes next are the buttons of the strip. */
function begin(source: string, what: string): void {
  leaveFirst();
  open(source, what);
  requestAnimationFrame(() => {
    if (document.activeElement?.matches("body, .gallery *")) document.getElementById("verdict")?.focus({ preventScroll: true });
    window.scrollTo(0, 0); // on a small screen it was opened from far below
  });
}

/** Text as the command reads it: UTF-8, or UTF-16 with its mark; null for anything else. */
function decode(content: ArrayBuffer): string | null {
  const [first, second] = new Uint8Array(content);
  const encoding = first === 0xff && second === 0xfe ? "utf-16le" : first === 0xfe && second === 0xff ? "utf-16be" : "utf-8";
  try {
    return new TextDecoder(encoding, { fatal: true }).decode(content);
  } catch {
    return null;
  }
}

/** Open a text that is a design; of any other, say what is wrong with it. */
export function takeText(name: string, content: string, what: string): void {
  const { errors, empty } = parse(content);
  if (errors.length) return void say(`${name} holds no design: ${errors[0].message}`, true);
  const same = content === text.value;
  begin(content, what);
  const notes = empty.slice(0, 5).map(({ path }) => path.join(" › ")).join(", ");
  say(`${name} is ${same ? "what is open already" : "open"}.${canUndo.value && !same ? " Undo brings back what was here." : ""}${notes ? ` Fields without a value count as if they were not there: ${notes}.` : ""}`);
}

/** What a file does not say itself: it waits until a person has said it. */
interface Question {
  name: string;
  words: string;
  choices: { words: string; take(): void }[];
  diameter?(value: number): void; // another than those that are offered
}
const asking = signal<Question | null>(null);
export const assumes = signal(false); // a first design was made about points: what it assumes is shown

async function takePoints(file: File, format: string, more = ""): Promise<void> {
  const { name } = file;
  if (!present() && unread.value) return void say(unread.value, true);
  const made = await convert(name, (words) => words.replaceAll(`content.${format}`, name), send("POST", `/v1/conversions?from=${format}&to=csv${more}`, file, { "Content-Type": "text/plain" }), async (rule, detail) => {
    const headed = rule === "csv-header" ? withHeader(decode(await file.arrayBuffer()) ?? "") : null;
    if (rule === "several-diameters" && !more) {
      const diameters = [...detail.split("diameters:").pop()!.matchAll(/([\d.]+) mm/g)].map(([, value]) => Number(value)).filter((value) => value > 0);
      const take = (diameter: number) => void takePoints(file, format, `&sphere_diameter_mm=${diameter}`);
      asking.value = { name, words: `${detail}. Which of them are the fiducials?`, diameter: take, choices: [...new Set(diameters)].map((diameter) => ({ words: `Those of ${diameter} mm`, take: () => take(diameter) })) };
    } else if (headed) {
      const take = (unit: string) => void takePoints(new File([headed.of(unit)], name), format);
      asking.value = { name, words: `${name} does not say what its columns are. Are they ${headed.labels ? "a label and then " : ""}x, y, z? Its first row: ${headed.first}`, choices: ["mm", "cm", "m", "in"].map((unit) => ({ words: `Yes, in ${unit === "in" ? "inches" : unit}`, take: () => take(unit) })) };
    }
    return asking.value !== null;
  });
  if (!made) return;
  const base = present(), own = new Map((base?.fiducials?.points ?? []).map((p: Json) => [p.label, p]));
  const points = made.fiducials.map((p: Json) => ({ ...(own.get(p.label) ?? {}), label: p.label, position_mm: rounded(p.position_mm, 4) }));
  const left = (made.bodies ?? []).filter((body: Json) => body.reason).map((body: Json) => `${body.path} was left: ${body.reason}`);
  const notes = [...made.notes, ...left].slice(0, 5).join("; ");
  if (!base) {
    begin(firstDesign(points, name, await wishes()), `Open ${name}`);
    assumes.value = true;
    return void say(`${points.length} fiducials of ${name} are in a first design. What nobody stated is assumed, and listed beside the pictures.${notes ? ` ${notes}` : ""}`);
  }
  const kept = Object.fromEntries(Object.entries(base.fiducials ?? {}).filter(([field]) => !["points", "file", "region", "frame"].includes(field)));
  edit([{ path: ["fiducials"], value: { points, ...kept } }], `Fiducials of ${name}`);
  say(`${points.length} fiducials of ${name} are in the design.${canUndo.value ? " Undo brings back those before." : ""}${notes ? ` ${notes}` : ""}`);
}

/** A table of x, y, z, perhaps after a label, whose header says no unit, or that has none: what it is with one. */
export function withHeader(content: string): { first: string; labels: boolean; of(unit: string): string } | null {
  const lines = content.split(/\r?\n/).filter((line) => line.trim() && !/^\s*#/.test(line)), cut = ["\t", ";", ","].find((mark) => lines[0]?.includes(mark));
  const rows = lines.map((line) => (cut ? line.split(cut) : line.trim().split(/\s+/)).map((cell) => cell.trim())), wide = rows[0]?.length;
  const body = /^"?x"?$/i.test(rows[0]?.[wide - 3] ?? "") ? rows.slice(1) : rows;
  if ((wide !== 3 && wide !== 4) || !body.length || body.some((row) => row.length !== wide || row.slice(-3).some((cell) => readNumber(cell.replace(",", ".")) === null))) return null;
  return { first: body[0].join(", "), labels: wide === 4, of: (unit) => [[...(wide === 4 ? ["label"] : []), ..."xyz"].map((name) => (name === "label" ? name : `${name}_${unit}`)), ...body].map((row) => row.join(cut ?? "\t")).join("\n") };
}

/** Asked in the page, beside what else is said. */
export function Asking() {
  const question = asking.value, form = useRef<HTMLFormElement>(null);
  useEffect(() => form.current?.querySelector<HTMLElement>("button, input")?.focus(), [question]);
  if (!question) return null;
  return (
    <form ref={form} class="problems asking" aria-label={`Fiducials of ${question.name}`} onKeyDown={(event) => { if (event.key === "Escape") asking.value = null; }} onSubmit={(event) => {
      event.preventDefault();
      const field = event.currentTarget.querySelector("input"), diameter = field && readNumber(field.value, "mm");
      field?.setCustomValidity(diameter !== null && diameter > 0 ? "" : "a diameter in mm, such as 3 or 2,5");
      if (field && event.currentTarget.reportValidity()) question.diameter?.(diameter!);
    }}>
      <p>{question.words}</p>
      <p class="controls">
        {question.choices.map(({ words, take }) => <button type="button" key={words} onClick={take}>{words}</button>)}
        {question.diameter && <><label>another diameter, mm <input type="text" inputMode="decimal" size={5} required onInput={(event) => event.currentTarget.setCustomValidity("")} /></label> <button type="submit">Take these</button></>}
        <button type="button" onClick={() => (asking.value = null)}>Take none</button>
      </p>
    </form>
  );
}

/** The first door: points of one's own, seen by a C-arm that is chosen. */
export function OwnPoints() {
  return (
    <section class="own" aria-label="Your own beads">
      <h2>Begin with your own beads</h2>
      <p>A list of where they are is enough: a CSV file (columns label, x_mm, y_mm, z_mm), markups of 3D Slicer (.mrk.json, .fcsv), or a STEP file with balls in it. Seats, tolerances and a target are assumed about them, and are yours to correct.</p>
      <p class="controls">
        <CArmChoice />
        <OpenFile words="Choose a file of beads" />
        <span class="note">or drop one anywhere on this page</span>
      </p>
      <CArmNote />
    </section>
  );
}

// --- the gallery ---------------------------------------------------------------------------------------------------------

interface Example {
  name: string;
  title: string;
  description: string;
}
const gallery = signal<Example[] | null>(null), FIRST = "demo"; // which shows a newcomer how

/** What a card shows of its design: beads and targets from the front, and the verdict by estimate. */
interface Glimpse {
  beads: number[][];
  targets: number[][];
  status: string | null;
}
const glimpses = signal<Record<string, Glimpse>>({});
const CALM = 600; // ms that the first page is looked at before its cards are filled
let looking = false;

/** Fill the cards one after the other, for as long as the first page is shown: a design's own scores come first. */
async function glimpse(): Promise<void> {
  if (looking) return;
  looking = true;
  try {
    for (const { name } of gallery.value ?? []) {
      if (glimpses.value[name]) continue;
      if (present()) return;
      const response = await send("GET", `/v1/examples/${name}`, undefined, { Accept: "application/yaml" });
      if (!response.ok) return;
      const { data } = parse(await response.text());
      const places = (list: Json): number[][] => (Array.isArray(list) ? list : []).map((each: Json) => each?.position_mm).filter((at: Json) => Array.isArray(at) && at.length === 3);
      const number = ["/views/0/fiducial_noise_px", "/requirements/0/limit_mm"].find((pointer) => typeof valueAt(data, pathOf(pointer)) === "number");
      let status: string | null = null;
      if (number && !present()) {
        const judged = await send("POST", "/v1/scores/batch", { design: data, table: { [number]: [valueAt(data, pathOf(number))] }, columns: ["verdict"] });
        if (judged.ok) status = (await judged.json()).columns.verdict[0] || null;
      }
      glimpses.value = { ...glimpses.value, [name]: { beads: places(data?.fiducials?.points), targets: places(data?.targets), status } };
    }
  } catch {
    // the cards are good without
  } finally {
    looking = false;
  }
}

function Thumbnail({ of }: { of: Glimpse | undefined }) {
  const all = [...(of?.beads ?? []), ...(of?.targets.slice(0, 20) ?? [])];
  const ends = [0, 2].map((k) => [Math.min(...all.map((p) => p[k])), Math.max(...all.map((p) => p[k]))]);
  const scale = 44 / Math.max(1, ...ends.map(([low, high]) => high - low)), x = (p: number[]) => 30 + scale * (p[0] - (ends[0][0] + ends[0][1]) / 2), y = (p: number[]) => 30 - scale * (p[2] - (ends[1][0] + ends[1][1]) / 2);
  return (
    <svg class="thumbnail" viewBox="0 0 60 60" aria-hidden="true">
      {of?.beads.map((p, k) => <circle key={k} cx={x(p)} cy={y(p)} r="2.6" />)}
      {of?.beads.length ? of.targets.slice(0, 20).map((p, k) => <path key={k} d={`M${x(p) - 3} ${y(p) - 3}l6 6M${x(p) + 3} ${y(p) - 3}l-6 6`} />) : null}
    </svg>
  );
}

export function Gallery() {
  useEffect(() => {
    if (!gallery.value) void send("GET", "/v1/examples").then(async (r) => r.ok && (gallery.value = (await r.json()).examples.sort((a: Example, b: Example) => Number(b.name === FIRST) - Number(a.name === FIRST)))).catch(() => null);
  }, [key.value]);
  useEffect(() => {
    const timer = window.setTimeout(() => void glimpse(), CALM);
    return () => window.clearTimeout(timer);
  }, [gallery.value]);
  const take = async (name: string) => {
    const response = await send("GET", `/v1/examples/${name}`, undefined, { Accept: "application/yaml" }).catch(() => null);
    if (!response) say(unreachable().title, true);
    else if (response.ok) {
      begin(await response.text(), `Example ${name}`);
      if (name === FIRST) beginMinute();
    }
  };
  return (
    <ul class="gallery">
      {(gallery.value ?? []).map((example) => (
        <li key={example.name}>
          <button type="button" onClick={() => take(example.name)}>
            <Thumbnail of={glimpses.value[example.name]} />
            <span class="about">
              <strong>{example.title}</strong>
              {glimpses.value[example.name]?.status && <em class={`status ${glimpses.value[example.name].status}`}>{VERDICTS[glimpses.value[example.name].status!] ?? glimpses.value[example.name].status}</em>}
              <span>{/^.*?\.(?= |$)/.exec(example.description.replace(/ \(docs\/.*?\)/, ""))?.[0] ?? example.description}</span>
            </span>
          </button>
        </li>
      ))}
    </ul>
  );
}

export function OpenFile({ words }: { words: string }) {
  return (
    <label class="button">
      {words}
      <input type="file" class="hidden" multiple accept=".yaml,.yml,.json,.csv,.tsv,.txt,.fcsv,.step,.stp,.p21,.stl,.urdf,.xlsx,.ods,.dcm,.dicom" onChange={(event) => {
        const files = [...(event.currentTarget.files ?? [])];
        event.currentTarget.value = "";
        void takeFiles(files);
      }} />
    </label>
  );
}

// --- out ------------------------------------------------------------------------------------------------------------------

export function TakeAway() {
  const copyLink = async () => {
    const link = await linkOf(text.value);
    if (link.length > LONGEST_LINK) {
      save(new Blob([text.value], { type: "application/yaml" }), `${fileName()}.yaml`);
      say(`The design is too large for a link (${link.length} characters; ${LONGEST_LINK} survive mail and chats): it was saved as a file, send that.`);
      return;
    }
    linked.value = text.value;
    history.replaceState(null, "", link);
    await copy(link, "The link holds the whole design, and is copied.");
  };
  const address = `${location.origin}${location.pathname}`.replace(/\/$/, "");
  const forms: [string, () => string][] = [
    ["curl", () => `curl -s -H 'Content-Type: application/yaml' --data-binary @${fileName()}.yaml ${address}/v1/scores`],
    ["Python", () => `from tailstack import load_design, score\n\ndesign = load_design("${fileName()}.yaml")\nprint(score(design).targets[0].p95_mm)\n`],
    ["command", () => `tailstack score ${fileName()}.yaml`],
    ["CI gate", () => `# .github/workflows/tolerances.yml; COMMIT is that of your copy of tailstack\nname: tolerances\non: [pull_request]\npermissions: { contents: read }\njobs:\n  gate:\n    runs-on: ubuntu-24.04\n    timeout-minutes: 15\n    steps:\n      - uses: actions/checkout@11bd71901bbe5b1630ceea73d27597364c9af683 # v4.2.2\n      - uses: YOUR-ORGANISATION/tailstack@COMMIT\n        with: { designs: ${fileName()}.yaml, mode: auto }\n`],
  ];
  return (
    <>
    <p class="controls" role="group" aria-label="To the supplier">
      <strong>To the supplier</strong>
      {(["pdf", "html", "csv"] as const).map((form) => <button type="button" key={form} aria-label={`Sheet for the supplier as ${form.toUpperCase()}`} onClick={() => handOver(form)}>{form.toUpperCase()}</button>)}
      <span class="note">beads, seats and tolerances as drawn, dimensioned; nothing of what was computed</span>
    </p>
    <div class="controls" role="group" aria-label="Share and save">
      <button type="button" onClick={() => save(new Blob([text.value], { type: "application/yaml" }), `${fileName()}.yaml`)}>Save YAML</button>
      <button type="button" onClick={() => save(new Blob([JSON.stringify(whole.value, null, 2)], { type: "application/json" }), `${fileName()}.json`)}>Save JSON</button>
      <button type="button" onClick={copyLink}>Link to this design</button>
      {forms.map(([name, make]) => <button type="button" key={name} onClick={() => copy(make(), `Copied as ${name}.`)}>{`Copy as ${name}`}</button>)}
    </div>
    </>
  );
}

export async function copy(content: string, words: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(content);
    say(words);
  } catch {
    say(`${words.replace(/ (and is copied|is copied)\.?|Copied/, "")} The browser does not let the page copy; here it is: ${content}`);
  }
}
