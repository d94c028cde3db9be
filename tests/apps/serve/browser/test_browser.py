"""The page of drift serve in a real browser: the scenario of a first case, and what hostile files
may do there.
"""

import re
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from desks import NASTY, Server, finished, until

from drift.products.files import manifest

pytestmark = pytest.mark.browser

PATIENCE = 120_000  # [ms] for a run of a small case on a busy machine


class Page:
    """The page of a folder, opened by the printed address, and all that the browser complains of."""

    def __init__(self, browser: Any, served: Server, **options: Any) -> None:
        self.context = browser.new_context(**options)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.page.on(
            "console",
            lambda told: (
                told.type in ("error", "warning")
                and "willReadFrequently" not in told.text  # a hint on speed, to OpenLayers
                and self.complaints.append(told.text)
            ),
        )
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(f"http://{served.host}/?token={served.secret.token}")
        self.page.get_by_role("heading", name=f"drift: {served.folder.name}").wait_for()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    folder = tmp_path / "cases"
    folder.mkdir()
    with Server(folder.resolve()) as one:
        yield one


def test_the_story_of_a_first_case(browser: Any, served: Server) -> None:
    """From a copy of a shipped case by a mistake that is seen and mended to the report, by keyboard
    where it matters.
    """
    with Page(browser, served) as opened:
        page = opened.page
        assert page.url == f"http://{served.host}/"  # the key does not stay in the address
        page.get_by_role("button", name="Use a copy of overdue_boat").click()
        page.get_by_role("heading", name="overdue_boat.toml").wait_for()
        page.get_by_role("button", name="Text", exact=True).click()
        text = page.get_by_role("textbox", name=re.compile("Text of the case"))
        case = text.input_value()
        assert case == (served.folder / "overdue_boat.toml").read_text(encoding="utf-8")
        assert page.locator("#numbers").inner_text().split() == [
            str(k + 1) for k in range(len(case.split("\n")))
        ]
        small = re.sub(r"(?m)^particles = .*$", "", case)
        small = re.sub(r"(?m)^(title = .*)$", r"\1\nparticles = 2000", small, count=1)
        text.fill(small.replace("start =", "start ==", 1))
        page.get_by_role("button", name="Check").click()
        page.get_by_role("heading", name="One mistake").wait_for(timeout=PATIENCE)
        line = next(
            k for k, words in enumerate(small.split("\n"), 1) if words.startswith("start =")
        )
        page.get_by_role("button", name=f"Go to line {line}").click()
        assert page.evaluate("document.activeElement.id") == "text"
        assert page.evaluate("getSelection().toString() || text.value.slice(text.selectionStart, text.selectionEnd)").startswith("start ==")  # fmt: skip
        text.fill(small)
        assert page.locator("#said").inner_text() == "Not saved yet."
        text.press("Control+s")
        page.get_by_text("Saved.", exact=True).wait_for()
        page.get_by_role("button", name="Check").click()
        page.get_by_role("heading", name="Valid").wait_for(timeout=PATIENCE)
        page.get_by_role("button", name="Run the forecast").focus()
        page.keyboard.press("Enter")
        page.get_by_role("progressbar", name="Progress of overdue_boat.toml").wait_for()
        # it tells a phase
        until(lambda: page.evaluate("document.querySelector('#jobs .soft').textContent"), 120)
        link = page.get_by_role("link", name="Open the report of overdue_boat-forecast")
        link.wait_for(timeout=PATIENCE)
        page.get_by_role("button", name="Cases and results").click()
        page.locator("#runs").get_by_text("Overdue boat", exact=False).first.wait_for()
        with opened.context.expect_page() as second:
            link.click()
        report = second.value
        report.on("pageerror", lambda error: opened.complaints.append(str(error)))
        report.get_by_role("heading", name=re.compile("Overdue boat")).wait_for(timeout=PATIENCE)
        until(lambda: report.evaluate("document.querySelector('#map canvas') !== null"), 60)
        assert report.evaluate("self.origin") == "null"  # apart from our page
        # a link of the report to what lies beside it
        with report.expect_download(timeout=PATIENCE) as saved:
            report.get_by_role("link", name="forecast.nc").click()
        assert (
            Path(saved.value.path()).read_bytes()
            == (served.folder / "overdue_boat-forecast" / "forecast.nc").read_bytes()
        )
        assert opened.complaints == []


def test_a_change_by_somebody_else_is_not_lost(browser: Any, served: Server) -> None:
    (served.folder / "shared.toml").write_text('title = "first"\n', encoding="utf-8")
    with Page(browser, served) as opened:
        page = opened.page
        page.get_by_role("button", name="shared.toml").click()
        page.get_by_role("heading", name="shared.toml").wait_for()
        (served.folder / "shared.toml").write_text('title = "second"\n', encoding="utf-8")
        page.get_by_role("button", name="Text", exact=True).click()
        page.locator("#text").fill('title = "third"\n')
        page.get_by_role("button", name="Save").click()
        page.get_by_text("was changed in the meantime").wait_for()
        assert (served.folder / "shared.toml").read_text(encoding="utf-8") == 'title = "second"\n'


def test_a_new_case_is_called_as_its_name_says(browser: Any, served: Server) -> None:
    """Its title is the name that was typed; without a name a line says that there is none."""
    with Page(browser, served) as opened:
        page = opened.page
        for empty in ("", "   ", ".toml"):
            page.get_by_label("New case").fill(empty)
            page.get_by_role("button", name="Write one").click()
            assert (
                "A case needs a name"
                in page.get_by_role("alert").filter(has_text="name").inner_text()
            )
            assert page.locator("#editor").is_hidden()
        page.on("dialog", lambda dialog: dialog.accept())  # leaves what is not saved
        for given, title in (
            ("falmouth_search.toml", "falmouth search"),
            ('a "b" c', r"a \"b\" c"),
        ):
            page.get_by_role("button", name="Cases and results").click()
            page.get_by_label("New case").fill(given)
            page.get_by_role("button", name="Write one").click()
            assert page.locator("#text").input_value() == f'title = "{title}"\n'
            assert page.locator("#new-said").inner_text() == ""
        assert page.locator("#editor-title").inner_text() == 'a "b" c.toml'
        assert opened.complaints == []


def test_hostile_names_are_text(browser: Any, served: Server) -> None:
    """Titles, warnings and errors with markup in them are shown as they are written."""
    finished(served.folder / "done", NASTY)
    (served.folder / "nasty.toml").write_text(
        f"title = '{NASTY}'\n'{NASTY}' = 1\n", encoding="utf-8"
    )
    with Page(browser, served) as opened:
        page = opened.page
        page.on("dialog", lambda dialog: opened.complaints.append(dialog.message))
        page.get_by_role("link", name=NASTY).wait_for()
        page.get_by_role("button", name="nasty.toml").click()
        page.get_by_role("button", name="Check").click()
        page.get_by_role("heading", name=re.compile("mistake")).wait_for(timeout=PATIENCE)
        assert "<img src=x" in page.locator("#checked").inner_text()
        assert page.locator("img").count() == 0
        assert opened.complaints == []


def test_a_hostile_report_cannot_act_for_the_user(browser: Any, served: Server) -> None:
    """Its script runs, and neither reads our lists, nor writes a case, nor reaches another port,
    nor our page.
    """
    with closing(socket.socket()) as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        other.settimeout(0.2)
        script = f"""<title>start</title><script>(async () => {{
          const tried = [];
          const attempt = async (name, work) => {{ try {{ await work(); tried.push(name); }} catch {{}} }};
          await attempt("read", async () => (await fetch("/api/folder")).text());
          await attempt("write", async () => (await fetch("/api/cases/owned.toml", {{ method: "POST", credentials: "include",
            headers: {{ "Content-Type": "application/json" }}, body: '{{"text": "x", "digest": null}}' }})).text());
          await attempt("beacon", async () => {{ if (!navigator.sendBeacon("http://127.0.0.1:{other.getsockname()[1]}/x")) throw 1; }});
          await attempt("image", () => new Promise((done, failed) => {{ const i = new Image(); i.onload = done; i.onerror = failed; i.src = "/runs/x.png"; }}));
          await attempt("opener", async () => window.opener.document.title);
          await attempt("cookie", async () => {{ if (!document.cookie) throw 1; }});
          await attempt("storage", async () => localStorage.setItem("x", "y"));
          document.title = "tried:" + tried.join(",");
        }})()</script>"""
        finished(served.folder / "evil")
        place = served.folder / "evil"
        (place / "report.html").write_text(script, encoding="utf-8")
        (place / manifest.NAME).unlink()
        (place / manifest.NAME).write_text(
            manifest.manifest_text(manifest.manifest_of("run", sorted(place.iterdir()))),
            encoding="utf-8",
        )
        with Page(browser, served) as opened, opened.context.expect_page() as second:
            opened.page.get_by_role("link", name="a run", exact=True).click()
            report = second.value
            until(lambda: report.title().startswith("tried:"), 30)
            tried = report.title().removeprefix("tried:")
        # the browser takes it in, and its policy drops it
        assert set(filter(None, tried.split(","))) <= {"beacon"}
        with pytest.raises(TimeoutError):
            other.accept()
    assert not (served.folder / "owned.toml").exists()


def test_another_site_cannot_use_the_browser_against_us(
    browser: Any, served: Server, tmp_path: Path
) -> None:
    """A page of another origin, in a browser that has our cookie: a form, a script, an image, a
    frame.
    """
    with Page(browser, served) as opened:
        page = opened.context.new_page()
        page.route(
            "http://evil.example/",
            lambda route: route.fulfill(body="<title>evil</title>", content_type="text/html"),
        )
        page.goto("http://evil.example/")
        told = page.evaluate(
            """async (host) => {
              const got = [];
              for (const mode of ["cors", "no-cors"]) for (const type of ["application/json", "text/plain"]) {
                try {
                  const answer = await fetch(`http://${host}/api/cases/owned.toml`, { method: "POST", mode, credentials: "include",
                    headers: { "Content-Type": type }, body: '{"text": "x", "digest": null}' });
                  if (answer.type !== "opaque") got.push(`${mode} ${type} ${answer.status}`);
                } catch {}
              }
              try { got.push(await (await fetch(`http://${host}/api/folder`, { credentials: "include" })).text()); } catch {}
              const frame = document.createElement("iframe");
              frame.src = `http://${host}/`;
              document.body.append(frame);
              await new Promise((done) => setTimeout(done, 500));
              try { got.push(frame.contentDocument.title); } catch {}
              return got.filter(Boolean);
            }""",
            served.host,
        )
        assert told == []
    assert not (served.folder / "owned.toml").exists()


def test_on_a_phone_and_in_the_dark(browser: Any, served: Server) -> None:
    (served.folder / ("long" * 20 + ".toml")).write_text(
        'title = "' + "word" * 60 + '"\n' + "x" * 400, encoding="utf-8"
    )
    finished(served.folder / "done", "w" * 250)
    with Page(
        browser, served, viewport={"width": 360, "height": 740}, color_scheme="dark"
    ) as opened:
        page = opened.page
        page.get_by_role("button", name=re.compile("^longlong")).click()
        page.get_by_role("heading", name=re.compile("^longlong")).wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 31)"
        page.locator("#theme").click()
        assert (
            page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        )


@pytest.mark.parametrize("colours", ["light", "dark"])
def test_accessibility(browser: Any, served: Server, colours: str) -> None:
    """By axe-core's rules (WCAG 2.1 A and AA among them), with an editor, a mistake, a job, results
    and warnings.
    """
    from axe_playwright_python.sync_playwright import Axe

    finished(served.folder / "done", "a run", a_txt="words")
    (served.folder / "bad.toml").write_text("title = = 1\n" * 60, encoding="utf-8")
    with Page(browser, served, color_scheme=colours, bypass_csp=True) as opened:
        page = opened.page
        page.get_by_role("button", name="bad.toml").click()
        page.get_by_role("button", name="Check").click()
        page.get_by_role("heading", name="One mistake").wait_for(timeout=PATIENCE)
        page.get_by_role("button", name="Run the forecast").click()
        page.get_by_text(re.compile("Forecast of bad.toml: failed")).first.wait_for(
            timeout=PATIENCE
        )
        page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        found = Axe().run(page)
        assert [
            (v["id"], [n["html"] for n in v["nodes"]][:2]) for v in found.response["violations"]
        ] == []
