// The design as text: completion from the schema, the service's diagnostics at the line.
//
// CodeMirror writes its styles into the document that it stands in; inside a shadow root it adopts style sheets, which
// a strict policy of the page allows.

import { autocompletion, closeBrackets, type Completion, type CompletionContext, completionKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap } from "@codemirror/commands";
import { yaml } from "@codemirror/lang-yaml";
import { bracketMatching, HighlightStyle, syntaxHighlighting } from "@codemirror/language";
import { type Diagnostic, lintGutter, setDiagnostics } from "@codemirror/lint";
import { EditorState } from "@codemirror/state";
import { drawSelection, EditorView, highlightActiveLine, hoverTooltip, keymap, lineNumbers } from "@codemirror/view";
import { tags } from "@lezer/highlight";
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Document } from "yaml";
import { pathOf, refused } from "../api";
import { commit, draft, type Json, parse, type Path, shownPointer, text, valueAt } from "../state";
import { choose, resolve, schema, useSchema } from "./Form";

const PAUSE = 500; // ms after the last key, after which the text is taken over

const COLOURS = HighlightStyle.define([
  { tag: [tags.propertyName, tags.definition(tags.propertyName)], color: "var(--link)" },
  { tag: [tags.comment, tags.lineComment, tags.meta], color: "var(--quiet)", fontStyle: "italic" },
]);

/** The path of the line that the position is in, from the indentation of the lines above it. */
export function pathAt(source: string, position: number): { path: Path; typed: string } {
  const before = source.slice(0, position), lines = before.split("\n");
  const last = lines[lines.length - 1];
  const indent = (line: string) => line.length - line.trimStart().length;
  const path: Path = [];
  let level = last.trim() === "" ? last.length : indent(last);
  if (/^\s*- /.test(last)) level += 2;
  for (let k = lines.length - 1, index = 0; k >= 0; k -= 1) {
    const line = lines[k];
    if (!line.trim() || line.trim().startsWith("#")) continue;
    const dash = /^(\s*)- (.*)$/.exec(line), at = indent(line);
    if (k < lines.length - 1 || dash) {
      if (dash && at < level) {
        // an item of a list: count those before it
        index = 0;
        for (let m = k - 1; m >= 0; m -= 1) {
          if (!lines[m].trim()) continue;
          if (indent(lines[m]) < at) break;
          if (indent(lines[m]) === at && /^\s*- /.test(lines[m])) index += 1;
          else if (indent(lines[m]) === at && !/^\s*- /.test(lines[m])) break;
        }
        path.unshift(index);
        level = at + (k < lines.length - 1 ? 0.5 : 0.5);
        continue;
      }
      const name = /^\s*([\w-]+):\s*(#.*)?$/.exec(line);
      if (k < lines.length - 1 && name && at < level) {
        path.unshift(name[1]);
        level = at;
      }
    }
  }
  return { path, typed: /[\w-]*$/.exec(last)![0] };
}

function schemaAt(path: Path, data: Json): Json {
  let node = choose(schema.value, data);
  path.forEach((key, k) => {
    const value = valueAt(data, path.slice(0, k + 1));
    const next = typeof key === "number" ? node?.items ?? node?.prefixItems?.[key] : node?.properties?.[key] ?? node?.additionalProperties;
    node = next && typeof next === "object" ? choose(next, value) : null;
  });
  return node;
}

function complete(context: CompletionContext) {
  if (!schema.value) return null;
  const source = context.state.doc.toString(), line = context.state.doc.lineAt(context.pos);
  const before = line.text.slice(0, context.pos - line.from), value = /^\s*(?:- )?([\w-]+):\s+([\w.-]*)$/.exec(before);
  const { path } = pathAt(source, context.pos), data = parse(source).data;
  const node = schemaAt(path, data);
  if (value) {
    const field = node?.properties?.[value[1]];
    const choices: Json[] = field ? [field, ...(resolve(field).anyOf ?? []).map(resolve)].flatMap((f) => resolve(f).enum ?? (resolve(f).type === "boolean" ? [true, false] : [])) : [];
    return choices.length ? { from: context.pos - value[2].length, options: choices.map((c) => ({ label: String(c), type: "enum" })) } : null;
  }
  const word = context.matchBefore(/[\w-]*/);
  if (!word || (word.from === word.to && !context.explicit) || !node?.properties || !/^\s*(- )?[\w-]*$/.test(before)) return null;
  const known = new Set(Object.keys(valueAt(data, path) ?? {}));
  const options: Completion[] = Object.entries<Json>(node.properties).filter(([name]) => !known.has(name)).map(([name, part]) => ({
    label: name, type: "property", info: resolve(part).description, apply: `${name}: `, boost: (node.required ?? []).includes(name) ? 2 : 0,
  }));
  return { from: word.from, options };
}

const hover = hoverTooltip((view, position) => {
  const line = view.state.doc.lineAt(position), found = /^(\s*(?:- )?)([\w-]+):/.exec(line.text);
  if (!found || !schema.value || position > line.from + found[0].length) return null;
  const source = view.state.doc.toString(), { path } = pathAt(source, line.from + found[1].length);
  const field = schemaAt(path, parse(source).data)?.properties?.[found[2]];
  const words = field && resolve(field).description;
  if (!words) return null;
  const from = line.from + found[1].length;
  return { pos: from, end: from + found[2].length, create: () => {
    const dom = document.createElement("div");
    dom.textContent = words;
    dom.style.cssText = "max-width: 40em; padding: 4px 8px";
    return { dom };
  } };
});

/** Where a pointer's value stands in the text. */
function rangeOf(document: Document, pointer: string): [number, number] {
  const path = pathOf(pointer);
  for (let k = path.length; k >= 0; k -= 1) {
    const node: Json = k ? document.getIn(path.slice(0, k), true) : document.contents;
    if (node?.range) return [node.range[0], Math.max(node.range[0], Math.min(node.range[1], k ? node.range[1] : node.range[0] + 1))];
  }
  return [0, 0];
}

function diagnostics(source: string): Diagnostic[] {
  const { document, errors, empty } = parse(source), end = source.length;
  const diagnosed = (severity: Diagnostic["severity"]) => ({ message, from, to }: { message: string; from: number; to: number }): Diagnostic => ({ from: Math.min(from, end), to: Math.min(to, end), severity, message });
  const own = [...errors.map(diagnosed("error")), ...empty.map(diagnosed("warning"))];
  if (errors.length || source !== text.value) return own;
  return [...own, ...(refused.value?.errors ?? []).map((error) => {
    const [from, to] = rangeOf(document, error.pointer);
    return diagnosed("error")({ from, to, message: `${error.detail} ${error.hint}`.trim() });
  })];
}

/** Text that takes the place of a selection, or has several lines: a browser would write styles into it, which the policy of the page forbids. */
function replaceText(event: InputEvent, view: EditorView): boolean {
  const { data, inputType } = event, { from, to } = view.state.selection.main;
  if (data === null || event.isComposing || inputType !== "insertText" || view.state.selection.ranges.length > 1) return false;
  if (from === to && !data.includes("\n")) return false;
  event.preventDefault();
  const insert = () => view.state.update({ ...view.state.replaceSelection(data), userEvent: "input.type", scrollIntoView: true });
  if (!view.state.facet(EditorView.inputHandler).some((handle) => handle(view, from, to, data, insert))) view.dispatch(insert());
  return true;
}

export function Editor() {
  useSchema();
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const root = host.current!.shadowRoot ?? host.current!.attachShadow({ mode: "open" });
    let timer = 0;
    const take = (view: EditorView) => {
      const source = view.state.doc.toString();
      const broken = parse(source).errors.length > 0;
      if (!broken) commit(source, "Edit the text", Infinity);
      draft.value = broken ? source : "";
      view.dispatch(setDiagnostics(view.state, diagnostics(source)));
    };
    const view = new EditorView({
      parent: root as unknown as Element, root,
      state: EditorState.create({
        doc: draft.peek() || text.value,
        extensions: [
          lineNumbers(), history(), drawSelection(), bracketMatching(), closeBrackets(), highlightActiveLine(), lintGutter(), yaml(), hover,
          syntaxHighlighting(COLOURS), autocompletion({ override: [complete] }), EditorView.lineWrapping,
          EditorView.contentAttributes.of({ "aria-label": "Design as YAML" }), EditorView.domEventHandlers({ beforeinput: replaceText }),
          keymap.of([...completionKeymap, ...defaultKeymap, ...historyKeymap]),
          EditorView.updateListener.of((update) => {
            if (!update.docChanged || update.transactions.some((t) => t.isUserEvent("outside"))) return;
            window.clearTimeout(timer);
            timer = window.setTimeout(() => take(update.view), PAUSE);
          }),
          EditorView.theme({
            "&": { fontSize: "13px", height: "60vh", border: "1px solid var(--line)", background: "var(--ground)", color: "var(--ink)" },
            ".cm-scroller": { overflow: "auto", fontFamily: "'DejaVu Sans Mono', Menlo, Consolas, monospace" },
            ".cm-gutters": { background: "var(--raised)", color: "var(--quiet)", border: "none" },
            ".cm-activeLine, .cm-activeLineGutter": { background: "var(--hair)" },
            ".cm-cursor": { borderLeftColor: "var(--ink)" },
            ".cm-tooltip": { background: "var(--raised)", color: "var(--ink)", border: "1px solid var(--line)" },
            "&.cm-focused": { outline: "3px solid var(--link)" },
          }),
        ],
      }),
    });
    const show = (source: string) => {
      if (source !== view.state.doc.toString()) view.dispatch({ changes: { from: 0, to: view.state.doc.length, insert: source }, userEvent: "outside" });
    };
    view.scrollDOM.tabIndex = 0; // whoever has no mouse scrolls it, too
    const stopText = effect(() => {
      const next = text.value; // read whatever is typed: it is followed
      if (!draft.value && !view.hasFocus) show(next);
    });
    const stopLint = effect(() => {
      refused.value;
      view.dispatch(setDiagnostics(view.state, diagnostics(view.state.doc.toString())));
    });
    const left = () => {
      window.clearTimeout(timer);
      take(view);
      if (!draft.value) show(text.value);
    };
    view.contentDOM.addEventListener("blur", left);
    const stopShowing = effect(() => {
      if (shownPointer.value === null) return;
      const [from, to] = rangeOf(parse(text.value).document, shownPointer.value).map((at) => Math.min(at, view.state.doc.length)); // a draft may be shorter
      shownPointer.value = null;
      view.dispatch({ selection: { anchor: from, head: to }, effects: EditorView.scrollIntoView(from, { y: "center" }) });
      host.current!.scrollIntoView({ block: "nearest" });
      view.focus();
    });
    return () => {
      window.clearTimeout(timer);
      stopText();
      stopLint();
      stopShowing();
      view.destroy();
    };
  }, []);
  return (
    <>
      {draft.value && (
        <p class="remark">This text is no design yet, and the rest of the page shows the one before it: mend it where it is marked.{" "}
          <button type="button" class="small" onClick={() => (draft.value = "")}>Leave it for the design's text</button></p>
      )}
      <div class="editor" ref={host} />
      <p class="note">Tab goes on to what comes next; Ctrl+] and Ctrl+[ indent a line.</p>
    </>
  );
}
