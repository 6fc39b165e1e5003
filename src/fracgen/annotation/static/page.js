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

// Do something that may fail or take a while; errors are shown, and undefined is what it gives then.
export async function attempt(action, busy = "") {
  const sign = byId("busy");
  sign.hidden = !busy;
  sign.textContent = busy;
  try {
    const result = await action();
    complain("");
    return result;
  } catch (error) {
    complain(error.message);
    return undefined;
  } finally {
    sign.hidden = true;
  }
}

// Call `action` once, `wait` ms after the last of several calls.
export function later(action, wait) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(action, wait);
  };
}
