// The workbench: one page on which a designer plays with a design.

import { computed, effect, signal } from "@preact/signals";
import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import { answer, busy, current, dropped, key, keyWanted, refused } from "./api";
import { loadRecent, resume, runs, startProblem, unfinished } from "./jobs";
import { chosenBeads } from "./beads";
import { anyAssumed, Assumed, wanted } from "./parts/Assumed";
import { Contributors } from "./parts/Contributors";
import { Beads, Geometry } from "./parts/Controls";
import { assumes, Gallery, OpenFile, OwnPoints, takeFiles, takeText, TakeAway, Asking, working } from "./parts/Files";
import { Features } from "./parts/Features";
import { fetched } from "./parts/fetched";
import { Form } from "./parts/Form";
import { Levers } from "./parts/Levers";
import { Minute } from "./parts/Minute";
import { Elevations, Images } from "./parts/Pictures";
import { shownComment } from "./parts/Pin";
import { PlaceSwitches } from "./parts/Places";
import { Problems } from "./parts/Problems";
import { Runs } from "./parts/Runs";
import { History, Requirements, Verdict } from "./parts/Verdict";
import { Fold, listed, Tip, WordList } from "./parts/Words";
import { comments, design, draft, first, gesture, leaveFirst, linked, message, position, recall, redo, remember, restore, savedSteps, say, shownPointer, steps, text, textOfLink, undo } from "./state";

const theme = signal<string>(recall("tailstack.workbench.theme", "auto")), system = matchMedia("(prefers-color-scheme: dark)"), night = signal(system.matches);
system.addEventListener("change", () => (night.value = system.matches));
const dark = computed(() => (theme.value === "auto" ? night.value : theme.value === "dark"));
effect(() => {
  document.documentElement.dataset.theme = dark.value ? "dark" : "light";
  remember("tailstack.workbench.theme", theme.value);
});

// Which pictures are shown, and what part of a wide window they take, percent
const PICTURES = ["All", "X-ray images", "In space", "Elevations"], FEWEST = 25, MOST = 75;
const shown = signal(recall("tailstack.workbench.pictures", "All")), split = signal(recall("tailstack.workbench.split", 52));
effect(() => {
  remember("tailstack.workbench.pictures", shown.value);
  remember("tailstack.workbench.split", split.value);
});

function Page() {
  const name = String(design.value?.name ?? "");
  return (
    <>
      <a class="skip" href="#main">Skip to the pictures</a>
      <header>
        <h1><span class="product">tailstack</span> <span dir="auto" class="name">{name}</span></h1>
        <nav class="controls" aria-label="Page">
          <OpenFile words="Open a file" />
        </nav>
      </header>
      {!savedSteps.value && <p class="bad" role="alert">The browser keeps nothing (its storage is full or off): save the design as a file.</p>}
      {message.value && !working.value && <p class={message.value.bad ? "message bad" : "message"} role="status">{message.value.words} <button type="button" class="small" aria-label="Close the message" onClick={() => (message.value = null)}>×</button></p>}
      {startProblem.value && <div class="message bad"><Problems problem={startProblem.value} /><button type="button" class="small" onClick={() => (startProblem.value = null)}>Close</button></div>}
      {working.value && <p class="working" role="status">{working.value} … <progress aria-label={working.value} /></p>}
      <Asking />
      {keyWanted.value && <KeyWanted />}
      {steps.value.length > 0 && <Workbench />}
      {first.value && <><Welcome /><Foot /></>}
      <Tip />
      {listed.value && <WordList />}
      {manual.value && <manual.value onClose={() => (manual.value = null)} />}
    </>
  );
}

const licences = document.querySelector<HTMLLinkElement>("link[rel=license]")?.href; // written by the build

function Welcome() {
  return (
    <main id="main" tabIndex={-1}>
      {steps.value.length > 0 && <p><button type="button" onClick={leaveFirst}>Go on with <bdi>{String(design.value?.name ?? "the design")}</bdi></button> <span class="note">It is as you left it. What is opened here takes its place, and undo brings it back.</span></p>}
      <div class="lead">
        <p>A robot is navigated by two X-ray images of metal beads: how far from the target does its tool end up, which tolerance is to blame, and what would make it better?</p>
        <Sketch />
      </div>
      <OwnPoints />
      <h2>Begin with a design</h2>
      <p>New here? The first, the drill guide, shows you how, in a minute. Or take another, open <OpenFile words="a design of yours" />, or drop one here (.yaml, .json). Everything is computed by the service that this page came from; nothing is sent anywhere else.</p>
      <Gallery />
    </main>
  );
}

/** What this is about, in one picture: two sources, the beads in their carrier, the tool and how far off it is. */
function Sketch() {
  return (
    <svg class="sketch" viewBox="0 0 360 170" role="img" aria-label="Two X-ray sources see beads in a carrier that sits on a robot's flange; the tool beyond them misses the target by an error.">
      <path class="beam" d="M90 12L40 118H150ZM8 62L128 34V112Z" />
      <rect class="thing" x="36" y="120" width="118" height="6" /><rect class="thing" x="130" y="32" width="6" height="82" />
      <circle class="source" cx="90" cy="12" r="6" /><circle class="source" cx="8" cy="62" r="6" />
      <rect class="carrier" x="62" y="50" width="52" height="44" rx="4" />
      {[[70, 58], [104, 62], [76, 84], [98, 86], [88, 70]].map(([x, y]) => <circle key={x} class="bead" cx={x} cy={y} r="3.5" />)}
      <path class="arm" d="M114 72H172M172 56V88M172 72H250L262 72" />
      <path class="tool" d="M262 68L300 72L262 76Z" />
      <circle class="miss" cx="318" cy="78" r="20" /><path class="cross" d="M312 72l12 12M324 72l-12 12" />
      <text x="104" y="15">source</text><text x="54" y="142">image</text><text x="66" y="46">beads</text><text x="160" y="50">seats</text><text x="262" y="60">tool</text><text x="298" y="115">error</text>
    </svg>
  );
}

function KeyWanted() {
  return (
    <form class="problems" onSubmit={(event) => {
      event.preventDefault();
      const field = event.currentTarget.elements.namedItem("key") as HTMLInputElement, typed = field.value.replace(/[\s\u200b-\u200d\u2060\ufeff]/g, ""), strange = /[^!-~]/u.exec(typed)?.[0];
      field.setCustomValidity(strange ? `A key has no “${strange}” in it: copy it once more` : typed ? "" : "A key, as whoever runs the service gave it");
      if (!event.currentTarget.reportValidity()) return;
      key.value = typed;
      keyWanted.value = false;
      void loadRecent();
      resume();
    }}>
      <label>This service asks for an API key (it is kept in memory only) <input type="password" name="key" required autoComplete="off" onInput={(event) => event.currentTarget.setCustomValidity("")} /></label> <button type="submit">Use it</button>
    </form>
  );
}

function Workbench() {
  const pane = (name: string, Content: preact.ComponentType, heading = name) => (shown.value === "All" || shown.value === name) && (
    <section class={`pane ${name.replace(/\W/g, "-")}`} aria-label={name}><h2 class="hidden">{heading}</h2><Content /></section>
  );
  return (
    <>
      {!first.value && <><Verdict /><History /></>}
      <main id={first.value ? undefined : "main"} hidden={first.value} class="bench" tabIndex={-1} style={{ "--split": `${split.value}fr`, "--rest": `${100 - split.value}fr` }}>
        <div class="see">
          <Minute />
          <p class="controls" role="group" aria-label="Pictures">{PICTURES.map((name) => <button type="button" key={name} class="small" aria-pressed={shown.value === name} onClick={() => (shown.value = name)}>{name}</button>)}<span class="between" /><PlaceSwitches /><ArrangeSwitch /></p>
          {arranging.value && <Arrange />}
          {dropped.value && <Surface />}
          <div class={shown.value === "All" ? "panes all" : "panes"}>
            {pane("X-ray images", Images, "What the X-rays see")}
            {pane("In space", Space)}
            {pane("Elevations", Elevations)}
          </div>
          <section aria-label="Requirements"><h2>Requirements</h2><Requirements /></section>
          <Part title="Beads" open paper><Beads /></Part>
          <Part title="Run" open={runs.value.length > 0} summoned={runs.value.some(unfinished)} paper><Runs /></Part>
          <Part title="Many designs at once"><Many /></Part>
        </div>
        <Splitter />
        <div class="change">
          {anyAssumed.value && <Part title="What nobody stated" open={assumes.value} summoned={wanted.value}><Assumed /></Part>}
          <Part title="Views, pivots, targets, limits" summoned={assumes.value}><Geometry /><Features /></Part>
          <Part title="Versions"><Versions /></Part>
          <Part title={unsettled.value ? `Comments (${unsettled.value})` : "Comments"} summoned={shownComment.value ?? unsettled.value > 0}><Comments /></Part>
          <Part title="Share and save"><TakeAway /></Part>
          <Part title="All fields"><Form /></Part>
          <Part title="As text" open={draft.peek() !== ""} summoned={shownPointer.value !== null}><Editor /></Part>
          <Part title="Other designs"><Gallery /></Part>
          <Part title="What each lever can reach" open paper><section aria-label="Levers"><Levers /></section></Part>
          <Part title="What is to blame" open paper><section aria-label="Budget"><Contributors /></section></Part>
          <Foot />
        </div>
      </main>
    </>
  );
}

/** Between pictures and list: dragged, or moved with the arrow keys. */
function Splitter() {
  const set = (part: number) => (split.value = Math.round(Math.min(MOST, Math.max(FEWEST, part))));
  return (
    <div class="splitter" role="separator" tabIndex={0} aria-orientation="vertical" aria-label="Width of the pictures" aria-valuemin={FEWEST} aria-valuemax={MOST} aria-valuenow={split.value}
      onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
      onPointerMove={(event) => {
        const { left, width } = event.currentTarget.parentElement!.getBoundingClientRect();
        if (event.currentTarget.hasPointerCapture(event.pointerId)) set((100 * (event.clientX - left)) / width);
      }}
      onKeyDown={(event) => {
        const way = { ArrowLeft: -2, ArrowRight: 2 }[event.key];
        if (way) set(split.value + way);
      }} />
  );
}

/** What the numbers are of, and ways on; after the strip, so that few presses of Tab lead to its buttons. */
function Foot() {
  return (
    <footer>
      {steps.value.length > 0 && answer.value && (
        <Fold words="What these numbers are of, and what is in none of them"><p class={current.value ? "" : "old"}>{`Estimate (first order); design ${answer.value.score.provenance.design_sha256?.slice(0, 12)}; tailstack ${answer.value.score.provenance.tailstack_version}. Not in any number: ${answer.value.score.provenance.not_included.join("; ")}.`}</p></Fold>
      )}
      <p class="controls">
        <button type="button" onClick={() => void import("./parts/Manual").then((module) => (manual.value = module.Manual))}>The manual</button>
        <button type="button" onClick={() => (listed.value = true)}>What the words mean</button>
        <button type="button" onClick={() => (theme.value = dark.value ? "light" : "dark")}>{dark.value ? "Light" : "Dark"}</button>
        <a href="docs">The service's API</a>
        {licences && <a href={licences} title="of what this page contains">Licences</a>}
      </p>
    </footer>
  );
}

// What is fetched when it is shown: the first score does not wait for it
const manual = signal<preact.ComponentType<{ onClose: () => void }> | null>(null);
const Editor = fetched("The editor", () => import("./parts/Editor").then((module) => module.Editor));
const Space = fetched("The drawing in space", () => import("./parts/Space").then((module) => module.Space));
const Surface = fetched("The surface", () => import("./parts/Space").then((module) => module.Surface));
const Many = fetched("What scores many designs", () => import("./parts/Many").then((module) => module.Many));
const Versions = fetched("Versions", () => import("./parts/Review").then((module) => module.Versions));
const Comments = fetched("Comments", () => import("./parts/Review").then((module) => module.Comments));
const Arrange = fetched("What arranges beads", () => import("./parts/Arrange").then((module) => module.Arrange));

const unsettled = computed(() => comments.value.filter((comment) => !comment?.resolved).length);

const arranging = signal(false);
const ArrangeSwitch = () => <button type="button" class="small" aria-pressed={arranging.value} onClick={() => (arranging.value = !arranging.value)}>{chosenBeads.value.length > 1 ? `Arrange ${chosenBeads.value.length}` : "Arrange"}</button>;

function Part({ title, open: begin = false, summoned = false, paper = false, children }: { title: string; open?: boolean; summoned?: boolean | number; paper?: boolean; children: preact.ComponentChildren }) {
  const [isOpen, setOpen] = useState(begin);
  useEffect(() => {
    if (summoned !== false) setOpen(true);
  }, [summoned]);
  return (
    <details class={paper ? "part paper" : "part"} open={isOpen} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary><h2>{title}</h2></summary>
      {isOpen && children}
    </details>
  );
}

/** While something is dragged, what stands above it keeps its height, whatever it says: it stays under the pointer. */
const held = computed(() => gesture.value.length > 0);
effect(() => {
  const keep = held.value;
  for (const part of document.querySelectorAll<HTMLElement>(".steady")) part.style.height = keep ? `${part.getBoundingClientRect().height}px` : "";
});

document.addEventListener("keydown", (event) => {
  const at = event.composedPath()[0];
  // A field in which something is being typed undoes that; one that shows the design's value leaves it to the page
  const typing = at instanceof HTMLInputElement ? at.type !== "range" && at.type !== "checkbox" && at.value !== at.defaultValue : at instanceof HTMLElement && at.isContentEditable;
  const writes = at instanceof HTMLElement && (at.isContentEditable || /^(TEXTAREA|SELECT)$/.test(at.tagName) || (at instanceof HTMLInputElement && /^(text|password)$/.test(at.type)));
  if (event.key === "?" && !writes && !event.ctrlKey && !event.metaKey && !event.altKey) listed.value = true;
  if (typing || first.value || !(event.ctrlKey || event.metaKey)) return;
  if (event.key.toLowerCase() === "z") {
    event.preventDefault();
    (event.shiftKey ? redo : undo)();
  } else if (event.key.toLowerCase() === "y") {
    event.preventDefault();
    redo();
  }
});
// Between the first page and the design: what was pressed is gone, what comes next is there
let was = first.peek();
effect(() => {
  if (was === first.value) return;
  was = first.value;
  requestAnimationFrame(() => {
    document.getElementById(was ? "main" : "verdict")?.focus({ preventScroll: true });
    window.scrollTo(0, 0);
  });
});
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", (event) => {
  event.preventDefault();
  void takeFiles([...(event.dataTransfer?.files ?? [])]);
});
window.addEventListener("hashchange", () => void fromLink());

async function fromLink(): Promise<void> {
  try {
    const held = await textOfLink(location.hash);
    if (held === null) return void (linked.value = null);
    if (held !== text.value) takeText("The link", held, "Open the link");
    linked.value = held === text.value ? held : "";
  } catch {
    linked.value = "";
    say("The link was cut on its way: ask for it again, or for the file.", true);
  }
}

async function begin(): Promise<void> {
  await restore();
  await fromLink();
  render(<Page />, document.getElementById("page")!);
  resume();
}

// What tests and curious people look at
Object.assign(window, {
  workbench: {
    state: () => ({
      text: text.value, current: current.value, refused: refused.value, busy: busy.value,
      score: answer.value?.score ?? null, steps: steps.value.length, position: position.value,
    }),
  },
});

void begin();
