// Requests to this page's own server. What belongs to this tab lies below its token.

let token = "";

export async function begin() {
  token = (await request("/session", { method: "POST" })).token;
  addEventListener("pagehide", () => navigator.sendBeacon(url("end")));
  addEventListener("pageshow", (event) => event.persisted && location.reload()); // its session has ended
}

export function setup() {
  return request("/setup");
}

export function url(path, query = {}) {
  const search = new URLSearchParams(query).toString();
  return `/session/${token}/${path}${search ? `?${search}` : ""}`;
}

export function get(path, query) {
  return request(url(path, query));
}

export function post(path, body, query) {
  return request(url(path, query), { method: "POST", body });
}

export function put(path, body, query) {
  return request(url(path, query), { method: "PUT", body });
}

export function remove(path) {
  return request(url(path), { method: "DELETE" });
}

async function request(address, options = {}) {
  let response;
  try {
    response = await fetch(address, options);
  } catch {
    throw new Error("The server does not answer: is python -m fracgen.annotate still running?");
  }
  const content = await response.json().catch(() => null);
  if (!response.ok) throw new Error(content?.error || `The server answers with status ${response.status}.`);
  return content;
}
