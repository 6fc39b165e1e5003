// Small things that every part of the page needs.

export function byId(id) {
  return document.getElementById(id);
}

export function note(element, text, kind = "") {
  if (element.textContent !== text) element.textContent = text; // a reader speaks what changes
  element.className = `note ${kind}`.trim();
}

// Show an error until it is closed or the next action succeeds.
export function complain(text) {
  byId("alert").hidden = !text;
  byId("alert").firstElementChild.textContent = text;
}

// Do something that may fail or take a while; errors are shown, and undefined is what it gives then. While it is
// `busy` with something that is shown, nothing else can be done.
export async function attempt(action, busy = "") {
  if (busy && document.querySelector("main").inert) return undefined;
  const focused = document.activeElement;
  if (busy) setBusy(busy);
  try {
    const result = await action();
    complain("");
    return result;
  } catch (error) {
    complain(error.message);
    return undefined;
  } finally {
    if (busy) {
      setBusy("");
      focused?.focus();
    }
  }
}

function setBusy(words) {
  for (const part of document.querySelectorAll("header, main")) part.inert = Boolean(words);
  byId("busy").hidden = !words;
  byId("busy").textContent = words;
}

// Call `action` once, `wait` ms after the last of several calls.
export function later(action, wait) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(action, wait);
  };
}
