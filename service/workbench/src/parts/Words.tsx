// What the words mean: beside a word that is pointed at or has the focus, and all of them in one list.

import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { GLOSSARY } from "../glossary";

const shown = signal<{ word: string; of: HTMLElement } | null>(null);
export const listed = signal(false);

/** A word that is explained where it stands.  ``quiet``: it is no stop of the Tab key. */
export function Term({ word, quiet = false, children }: { word: string; quiet?: boolean; children: ComponentChildren }) {
  const show = (event: Event) => (shown.value = { word, of: event.currentTarget as HTMLElement });
  const hide = (event: Event) => {
    if (shown.value?.of === event.currentTarget) shown.value = null; // not that of a word which has got the focus meanwhile
  };
  return (
    <span class="term" tabIndex={quiet ? undefined : 0} role={quiet ? undefined : "note"} aria-describedby={!quiet && shown.value?.word === word ? "tip" : undefined}
      onMouseEnter={show} onMouseLeave={hide} onFocus={show} onBlur={hide} onKeyDown={(event) => { if (event.key === "Escape") hide(event); }}>{children}</span>
  );
}

/** A table by its name, which scrolls by itself where it is too wide.  ``kind``: of which its numbers are. */
export function Table({ name, head, caption, kind, of = "", look, children }: { name: string; head: ComponentChildren; caption?: ComponentChildren; kind?: string; of?: string; look?: string; children: ComponentChildren }) {
  return (
    <div class={`scroll ${of}`.trim()} tabIndex={0} role="region" aria-label={name}>
      <table class={look} data-kind={kind}>{caption && <caption>{caption}</caption>}<thead><tr>{head}</tr></thead><tbody>{children}</tbody></table>
    </div>
  );
}

/** What is folded until it is asked for; on paper it is there. */
export function Fold({ words, turned, children }: { words: string; turned?(open: boolean): void; children: ComponentChildren }) {
  const [open, setOpen] = useState(false);
  const turn = () => {
    setOpen(!open);
    turned?.(!open);
  };
  return <><button type="button" class="fold" aria-expanded={open} onClick={turn}>{words}</button><div class={open ? "" : "folded"}>{children}</div></>;
}

/** The explanation of one word, near it: a page that scrolls, as to a word that gets the focus, takes it along. */
export function Tip() {
  const box = useRef<HTMLParagraphElement>(null), tip = shown.value;
  useLayoutEffect(() => {
    if (!tip) return;
    const place = () => {
      const { left, bottom, top } = tip.of.getBoundingClientRect(), { offsetWidth: wide, offsetHeight: high } = box.current!;
      box.current!.style.left = `${Math.max(4, Math.min(left, innerWidth - wide - 4))}px`;
      box.current!.style.top = `${bottom + high + 8 < innerHeight ? bottom + 4 : Math.max(4, top - high - 4)}px`;
    };
    const follow = () => {
      const { bottom, top } = tip.of.getBoundingClientRect();
      if (bottom < 0 || top > innerHeight) shown.value = null;
      else place();
    };
    place();
    addEventListener("scroll", follow, { capture: true, passive: true });
    return () => removeEventListener("scroll", follow, { capture: true });
  }, [tip]);
  return tip && <p ref={box} class="tip" id="tip" role="tooltip"><strong>{tip.word}</strong>{`: ${GLOSSARY[tip.word]}`}</p>;
}

/** All words; shown and left by a button, the key ?, and Escape. */
export function WordList() {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current!.showModal(), []);
  return (
    <dialog ref={dialog} class="words" aria-label="What the words mean" onClose={() => (listed.value = false)}>
      <p class="controls"><strong>What the words mean</strong><button type="button" onClick={() => dialog.current!.close()}>Close</button></p>
      <dl tabIndex={0}>{Object.entries(GLOSSARY).map(([word, meaning]) => <div key={word}><dt>{word}</dt><dd>{meaning}</dd></div>)}</dl>
      <p class="note">Keys: Ctrl+Z and Ctrl+Shift+Z undo and redo; in a picture the arrows move the chosen bead by 1 mm, with Shift by 10, with Alt by 0.1; N and P choose the next and the one before, Ctrl+A all, Escape none; with Shift a press adds a bead, with Ctrl a drag draws a frame; + and − zoom, 0 fits; ? shows this list.</p>
    </dialog>
  );
}
