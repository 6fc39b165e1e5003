"""Who may use the page: only itself, only from this machine, whatever name a site gives to 127.0.0.1."""

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from tests.annotate.serving import BASE, served


@pytest.fixture(scope="module", name="client")
def client_fixture() -> Iterator[TestClient]:
    with served() as client:
        yield client


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "127.0.0.2:80",
                                  "localhost.evil.example", "", "127.0.0.1:80@evil.example", "[::1]:80"])  # fmt: skip
def test_a_name_of_the_internet_that_leads_here_is_refused(client: TestClient, host: str) -> None:
    """DNS rebinding: the browser thinks it is still at the other site."""
    for path in ("/", "/setup", "/static/main.js"):
        assert client.get(path, headers={"host": host}).status_code == 403
    assert client.post("/session", headers={"host": host, "origin": f"http://{host}"}).status_code == 403


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "localhost", "127.0.0.1:65535"])
def test_names_of_this_machine_are_served(client: TestClient, host: str) -> None:
    """Any port: it may be forwarded."""
    assert client.post("/session", headers={"host": host, "origin": f"http://{host}"}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "https://127.0.0.1:8000",
                                    "http://localhost:8000", "http://127.0.0.1"])  # fmt: skip
@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "GET"])
def test_requests_of_pages_of_other_sites_are_refused(client: TestClient, origin: str, method: str) -> None:
    """Also those of other servers of this machine, which have another port."""
    answer = client.request(method, "/session", headers={"origin": origin})
    assert answer.status_code == 403
    assert "another site" in answer.json()["error"]


def test_nothing_is_changed_without_an_origin(client: TestClient) -> None:
    """Browsers always send one with such requests."""
    bare = TestClient(client.app, base_url=BASE)
    assert bare.get("/").status_code == 200
    assert bare.post("/session").status_code == 403


def test_another_site_may_link_here_but_embed_nothing(client: TestClient) -> None:
    foreign = {"sec-fetch-site": "cross-site"}
    assert client.get("/static/main.js", headers=foreign).status_code == 403
    assert client.get("/", headers={**foreign, "sec-fetch-mode": "navigate"}).status_code == 200
    assert client.get("/static/main.js", headers={"sec-fetch-site": "same-origin"}).status_code == 200


@pytest.mark.parametrize("path", ["/", "/setup", "/static/page.css", "/favicon.ico", "/nothing", "/session/x/jobs"])
def test_every_answer_says_that_nothing_foreign_is_loaded(client: TestClient, path: str) -> None:
    headers = client.get(path).headers
    assert headers["content-security-policy"].startswith("default-src 'self'; ")
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cross-origin-resource-policy"] == "same-origin"


def test_there_is_no_favicon_and_no_page_about_the_server(client: TestClient) -> None:
    assert client.get("/favicon.ico").status_code == 204
    for path in ("/docs", "/redoc", "/openapi.json"):
        assert client.get(path).status_code == 404


@pytest.mark.parametrize("path", ["/static/../app.py", "/static/%2e%2e/app.py", "/static/..%2fapp.py",
                                  "/static//etc/passwd", "/static/%2fetc%2fpasswd"])  # fmt: skip
def test_only_files_of_the_page_are_served(client: TestClient, path: str) -> None:
    assert client.get(path).status_code in (403, 404)


def test_an_unknown_token_opens_nothing(client: TestClient) -> None:
    for path in ("jobs", "picture.jpg", "mask.png", "box?fit=fit"):
        assert client.get(f"/session/guessed/{path}").status_code == 404
    assert client.put("/session/guessed/picture", content=b"x").status_code == 404
