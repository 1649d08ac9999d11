// The manual: pages that the service has beside it, as Markdown, so that they are there without another host.

import { signal } from "@preact/signals";
import { marked } from "marked";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { send } from "../api";

const FIRST = "workbench.md", ALL = "README.md", TOP = new URL("manual/", new URL(".", location.href));
const trail = signal<string[]>([FIRST]); // addresses of pages below manual/, the one that is shown at the end
const page = signal<{ address: string; content: DocumentFragment } | null>(null);

/** A page of the manual with links that lead to the others; what lies outside of it keeps its words only. */
function toFragment(text: string, address: string): DocumentFragment {
  const { body } = new DOMParser().parseFromString(marked.parse(text, { async: false }), "text/html");
  for (const heading of body.querySelectorAll("h1, h2, h3")) heading.id = heading.textContent!.toLowerCase().replace(/[^\w\s-]/g, "").trim().replace(/\s/g, "-");
  for (const picture of body.querySelectorAll("img")) picture.replaceWith(Object.assign(document.createElement("em"), { textContent: picture.alt }));
  for (const link of body.querySelectorAll("a")) {
    const to = new URL(link.getAttribute("href")!, new URL(address, TOP));
    if (to.origin !== TOP.origin) Object.assign(link, { target: "_blank", rel: "noopener" });
    else if (to.pathname.startsWith(TOP.pathname) && to.pathname.endsWith(".md")) link.href = to.href;
    else link.replaceWith(...link.childNodes);
  }
  for (const block of body.querySelectorAll("pre")) block.tabIndex = 0; // it may scroll
  for (const table of body.querySelectorAll("table")) {
    const frame = Object.assign(document.createElement("div"), { className: "scroll", tabIndex: 0 });
    table.replaceWith(frame);
    frame.append(table);
  }
  const made = document.createDocumentFragment();
  made.append(...body.childNodes);
  return made;
}

async function read(address: string): Promise<DocumentFragment> {
  const answer = await send("GET", `/manual/${address.replace(/#.*/, "")}`).catch(() => null);
  if (answer?.ok) return toFragment(await answer.text(), address);
  const made = document.createDocumentFragment();
  made.append(answer ? `The manual of this service has no page ${address}.` : "The service does not answer; the page is asked for when this is opened again.");
  return made;
}

/** A page, and ways to the others; ``onClose`` when it is left. */
export function Manual({ onClose }: { onClose: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null), box = useRef<HTMLDivElement>(null), address = trail.value.at(-1)!;
  useEffect(() => {
    if (!dialog.current!.open) dialog.current!.showModal();
    let wanted = true;
    void read(address).then((content) => { if (wanted) page.value = { address, content }; });
    return () => { wanted = false; };
  }, [address]);
  useLayoutEffect(() => {
    if (!page.value) return;
    box.current!.replaceChildren(page.value.content.cloneNode(true));
    const section = page.value.address.split("#")[1];
    if (section) box.current!.querySelector(`#${CSS.escape(section)}`)?.scrollIntoView();
    else box.current!.scrollTop = 0;
    box.current!.focus();
  }, [page.value]);
  const follow = (event: MouseEvent) => {
    const link = (event.target as Element).closest("a");
    if (!link || link.target) return;
    event.preventDefault();
    trail.value = [...trail.value, link.href.slice(TOP.href.length)];
  };
  return (
    <dialog ref={dialog} class="words manual" aria-label="The manual" onClose={onClose}>
      <p class="controls">
        <strong>The manual</strong>
        <button type="button" disabled={trail.value.length < 2} onClick={() => (trail.value = trail.value.slice(0, -1))}>Back</button>
        <button type="button" onClick={() => (trail.value = [...trail.value, ALL])}>All pages</button>
        <button type="button" onClick={() => dialog.current!.close()}>Close</button>
      </p>
      <div ref={box} class="text" tabIndex={0} onClick={follow} />
    </dialog>
  );
}
