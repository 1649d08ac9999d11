// The workbench: one page on which a designer plays with a design.

import { effect, signal } from "@preact/signals";
import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import { answer, busy, current, key, keyWanted, refused } from "./api";
import { loadRecent, resume, runs, startProblem, unfinished } from "./jobs";
import { Beads, Geometry, HalfWidths } from "./parts/Controls";
import { Budget } from "./parts/Budget";
import { Gallery, OpenFile, takeFile, takeText, TakeAway, Variants, working } from "./parts/Files";
import { Form, loadSchema } from "./parts/Form";
import { Elevations, Images } from "./parts/Pictures";
import { Problems } from "./parts/Problems";
import { Runs } from "./parts/Runs";
import { Space } from "./parts/Space";
import { Requirements, Verdict } from "./parts/Verdict";
import { canRedo, canUndo, design, linked, message, position, recall, redo, remember, restore, savedSteps, say, shownPointer, steps, text, textOfLink, undo } from "./state";

const theme = signal<string>(recall("tailstack.workbench.theme", "auto"));
effect(() => {
  document.documentElement.dataset.theme = theme.value;
  remember("tailstack.workbench.theme", theme.value);
});
const dark = () => (theme.value === "auto" ? matchMedia("(prefers-color-scheme: dark)").matches : theme.value === "dark");

function Page() {
  const name = String(design.value?.name ?? "");
  return (
    <>
      <a class="skip" href="#main">Skip to the pictures</a>
      <header>
        <h1><span class="product">tailstack</span> <span dir="auto" class="name">{name}</span></h1>
        <nav class="controls" aria-label="Page">
          <button type="button" disabled={!canUndo.value} onClick={undo} title="Ctrl+Z">{`Undo${canUndo.value ? `: ${short(steps.value[position.value].what)}` : ""}`}</button>
          <button type="button" disabled={!canRedo.value} onClick={redo} title="Ctrl+Shift+Z">{`Redo${canRedo.value ? `: ${short(steps.value[position.value + 1].what)}` : ""}`}</button>
          <OpenFile words="Open a file" />
          <a class="button" href="docs">API</a>
          <button type="button" onClick={() => (theme.value = dark() ? "light" : "dark")}>{dark() ? "Light" : "Dark"}</button>
        </nav>
      </header>
      {!savedSteps.value && <p class="bad" role="alert">The browser keeps nothing (its storage is full or off): save the design as a file.</p>}
      {message.value && <p class={message.value.bad ? "message bad" : "message"} role="status">{message.value.words} <button type="button" class="small" aria-label="Close the message" onClick={() => (message.value = null)}>×</button></p>}
      {startProblem.value && <div class="message bad"><Problems problem={startProblem.value} /><button type="button" class="small" onClick={() => (startProblem.value = null)}>Close</button></div>}
      {working.value && <p class="working" role="status">{working.value} … <progress aria-label={working.value} /></p>}
      {keyWanted.value && <KeyWanted />}
      {steps.value.length === 0 ? <Welcome /> : <Workbench />}
    </>
  );
}

const licences = document.querySelector<HTMLLinkElement>("link[rel=license]")?.href; // written by the build
const short = (words: string) => (words.length > 26 ? `${words.slice(0, 25)}…` : words);

function Welcome() {
  return (
    <main id="main" tabIndex={-1}>
      <h2>Begin with a design</h2>
      <p>Take one of these, or drop a <code>.yaml</code> or <code>.json</code> design here. Nothing leaves this computer but for the service that this page came from.</p>
      <Gallery />
      <p><OpenFile words="Open a design of yours" /></p>
    </main>
  );
}

function KeyWanted() {
  return (
    <form class="problems" onSubmit={(event) => {
      event.preventDefault();
      key.value = new FormData(event.currentTarget).get("key") as string;
      keyWanted.value = false;
      void loadSchema();
      void loadRecent();
      resume();
    }}>
      <label>This service asks for an API key (it is kept in memory only) <input type="password" name="key" required autoComplete="off" /></label> <button type="submit">Use it</button>
    </form>
  );
}

function Workbench() {
  return (
    <>
      <Verdict />
      <main id="main" tabIndex={-1}>
        <div class="see">
          <section aria-label="X-ray images"><h2>What the X-rays see</h2><Images /></section>
          <section aria-label="Elevations"><h2>Elevations</h2><Elevations /></section>
          <section aria-label="Budget"><h2>What is to blame</h2><Budget /></section>
          <section aria-label="Requirements"><h2>Requirements</h2><Requirements /></section>
          <section aria-label="In space"><h2>In space</h2><Space /></section>
        </div>
        <div class="change">
          <Part title="Beads" open paper><Beads /></Part>
          <Part title="Half-widths and noise" open paper><HalfWidths /></Part>
          <Part title="Views, pivots, targets, limits"><Geometry /></Part>
          <Part title="Run" open={runs.value.length > 0} summoned={runs.value.some(unfinished)} paper><Runs /></Part>
          <Part title="Variants"><Variants /></Part>
          <Part title="Take away"><TakeAway /></Part>
          <Part title="All fields"><Form /></Part>
          <Part title="As text" summoned={shownPointer.value !== null}><TextPart /></Part>
          <Part title="Other designs"><Gallery /></Part>
        </div>
      </main>
      <footer>
        <p>{answer.value ? `Not in any number: ${answer.value.score.provenance.not_included.join("; ")}.` : ""}</p>
        <p class={current.value ? "" : "old"}>{answer.value ? `First order; design ${answer.value.score.provenance.design_sha256?.slice(0, 12)}; tailstack ${answer.value.score.provenance.tailstack_version}` : ""}</p>
        {licences && <p><a href={licences}>Licences of what this page contains</a></p>}
      </footer>
    </>
  );
}

/** The editor is fetched when it is opened: the first score does not wait for it. */
const editor = signal<preact.ComponentType | null>(null);
function TextPart() {
  const Editor = editor.value;
  useEffect(() => {
    if (!editor.value) void import("./parts/Editor").then((module) => (editor.value = module.Editor));
  }, []);
  return Editor ? <Editor /> : <p class="note">The editor is being fetched.</p>;
}

function Part({ title, open: begin = false, summoned = false, paper = false, children }: { title: string; open?: boolean; summoned?: boolean; paper?: boolean; children: preact.ComponentChildren }) {
  const [isOpen, setOpen] = useState(begin);
  useEffect(() => {
    if (summoned) setOpen(true);
  }, [summoned]);
  return (
    <details class={paper ? "part paper" : "part"} open={isOpen} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary><h2>{title}</h2></summary>
      {isOpen && children}
    </details>
  );
}

document.addEventListener("keydown", (event) => {
  const at = event.composedPath()[0];
  // A field in which something is being typed undoes that; one that shows the design's value leaves it to the page
  const typing = at instanceof HTMLInputElement ? at.type !== "range" && at.type !== "checkbox" && at.value !== at.defaultValue : at instanceof HTMLElement && at.isContentEditable;
  if (typing || !(event.ctrlKey || event.metaKey)) return;
  if (event.key.toLowerCase() === "z") {
    event.preventDefault();
    (event.shiftKey ? redo : undo)();
  } else if (event.key.toLowerCase() === "y") {
    event.preventDefault();
    redo();
  }
});
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", (event) => {
  event.preventDefault();
  const file = event.dataTransfer?.files[0];
  if (file) void takeFile(file);
});
window.addEventListener("hashchange", () => void fromLink());

async function fromLink(): Promise<void> {
  try {
    const held = await textOfLink(location.hash);
    if (held === null) return;
    if (held !== text.value) takeText("The link", held, "Open the link");
    linked.value = held === text.value ? held : "";
  } catch {
    linked.value = "";
    say("The link was cut on its way: ask for it again, or for the file.", true);
  }
}

async function begin(): Promise<void> {
  restore();
  await fromLink();
  render(<Page />, document.getElementById("page")!);
  void loadSchema();
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
