"""The page is well-formed, complete in one file, readable at any width, and keeps every text."""

import base64
import itertools
import re
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

import browser
from mppi_belief.report.page import Page, PageTable, Picture, Section, render

VOID = {"meta", "link", "img", "br", "hr"}
HOSTILE = """<script>alert("x")</script> & 'quotes' </td>"""
METHODS = ["EKF-iLQG", "CE-MPPI", "PIPF", "MPPI-Belief"]


class Parsed(HTMLParser):
    """Parses a page into start tags with attributes and texts of elements; checks the nesting."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[tuple[str, list[str]]] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append((tag, []))

    def handle_endtag(self, tag):
        name, text = self.open.pop()
        assert name == tag
        self.texts.append((tag, " ".join("".join(text).split())))

    def handle_data(self, data):
        for _, text in self.open:
            text.append(data)

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]

    def text(self, *tags: str) -> list[str]:
        return [text for name, text in self.texts if name in tags]


def draw(path: Path, size: tuple[float, float], title: str) -> None:
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    for index, method in enumerate(METHODS):
        axes.plot(
            [100, 500, 2500, 10000],
            [0.3 / (index + 1), 0.2, 0.18, 0.17 - 0.03 * index],
            "o-",
            label=method,
        )
    axes.set(xscale="log", xlabel="$w_{obs}$", ylabel="collision rate", title=title)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=200)


def table_1() -> PageTable:
    frame = pd.DataFrame(
        {
            "Method": METHODS,
            "Cost [95 %]": [
                "46.31 [45.40, 47.22]",
                "50.12 [49.30, 50.94]",
                "-",
                "55.27 [54.29, 56.25]",
            ],
            "Collided % [95 %]": [
                "24.5 [18.7, 31.1]",
                "22.0 [16.5, 28.4]",
                "18.0 [12.9, 24.0]",
                "0.5 [0.0, 2.8]",
            ],
            "Time (ms)": ["148", "13", "296", "18"],
            "Remark": [
                "replanned to convergence at every step, from the plan before",
                "",
                "",
                "within 95 %",
            ],
        }
    )
    return PageTable(
        "table-1",
        "Four controllers on the light-dark domain, 200 trials each",
        frame,
        bold={(3, 2)},
    )


def wide_table() -> PageTable:
    cells = [
        [name, *(f"{row + column / 8:.2f} ± 6.2" for column in range(8))]
        for row, name in enumerate(METHODS)
    ]
    names = [
        "Method",
        *(f"w_obs = {weight}" for weight in (100, 200, 500, 1000, 2000, 2500, 5000, 10000)),
    ]
    caption = (
        "Base cost without obstacle penalties by `w_obs`: mean and standard deviation over 200 "
        "trials per point"
    )
    return PageTable("sweep", caption, pd.DataFrame(cells, columns=names))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report")
    draw(path / "sweep.png", (7.2, 3.4), "Obstacle-weight sweep")
    draw(path / 'theta "0.5".png', (3.4, 2.6), "theta")
    draw(path / "paths.png", (7.2, 5.2), "Trajectories")
    for name in ("sweep.pdf", "table-1.csv", "table-1.tex"):
        (path / name).touch()
    return path


@pytest.fixture(scope="module")
def page() -> Page:
    command = (
        "mppi-belief reproduce --out outputs/report -m controller=belief,ce,pipf,ilqg "
        "n_trials=200 seed=0"
    )
    sweep = Picture(
        "sweep.png",
        "Collision rate against `w_obs`: MPPI-Belief falls to zero, the others stay above 11 %.",
    )
    return Page(
        title="Path Integral Control in Gaussian Belief Space: the experiments again",
        lead="Every number and figure of Sec. VII beside what was measured here, and where the two "
        "do not agree.",
        warnings=[
            "PIPF: 3 of 200 trials are missing; `mppi-belief reproduce` adds them.",
            "Times come from two machines.",
        ],
        sections=[
            Section(
                "Table I: is MPPI-Belief safer?",
                [
                    "Intervals are for the mean, 95 %; collisions have the exact interval.",
                    "Set `theta=0` for CE-MPPI.",
                ],
                [table_1()],
                [
                    Picture(
                        "paths.png",
                        "50 trials of each method in the plane; shading: the observation noise.",
                    )
                ],
            ),
            Section(
                "Obstacle weight w_obs",
                ["Two orders of magnitude of the weight."],
                [wide_table()],
                [sweep],
            ),
            Section(
                "Risk θ",
                ["Five values of theta."],
                pictures=[
                    Picture('theta "0.5".png', "Clearance against theta."),
                    Picture("gone.gif", "One trial, animated."),
                ],
            ),
        ],
        provenance=[
            ("Commit", "4a7f4001fefa10c03e45e15b8898ef62c29aaaa1"),
            ("Command", f"{command} planner.horizon=30 planner.control_std=2.75 workers=16"),
            ("Versions", "Python 3.11.2, jax 0.7.1, numpy 2.3.2"),
        ],
    )


@pytest.fixture(scope="module")
def parsed(page: Page, folder: Path) -> Parsed:
    return Parsed(render(page, folder))


def everywhere(text: str, warnings: int = 2) -> Page:
    """Returns a page with one text in every field."""
    frame = pd.DataFrame([[text, "1"], ["2", text]], columns=[text, text + " "])
    section = Section(
        text, [text, text], [PageTable(text, text, frame)], [Picture(f"{text}.png", text)]
    )
    return Page(text, text, [text] * warnings, [section, section], [(text, text)])


def test_the_page_needs_nothing_else(parsed, folder):
    addresses = []
    for _, attributes in parsed.tags:
        addresses += [attributes.get(name) for name in ("src", "href", "srcset")]
    assert not [address for address in addresses if address and re.match("[a-z]*:?//", address)]
    assert not parsed.all("script")
    assert not re.search(r"url\(|@import|@font-face", parsed.text("style")[0])
    pictures = [
        (folder / name).read_bytes() for name in ("paths.png", "sweep.png", 'theta "0.5".png')
    ]
    uris = ["data:image/png;base64," + base64.b64encode(data).decode() for data in pictures]
    assert [image["src"] for image in parsed.all("img")] == uris


def test_the_page_has_every_part(parsed, page):
    assert parsed.text("h1") == parsed.text("title") == [page.title]
    assert parsed.text("h2") == [
        "Warnings",
        *(section.title for section in page.sections),
        "Provenance",
    ]
    assert parsed.text("li")[:2] == [warning.replace("`", "") for warning in page.warnings]
    assert parsed.text("dt", "dd") == list(itertools.chain.from_iterable(page.provenance))
    assert parsed.all("html")[0]["lang"] == "en"
    assert "viewport" in [attributes.get("name") for attributes in parsed.all("meta")]


def test_every_anchor_leads_somewhere(parsed):
    ids = [attributes["id"] for _, attributes in parsed.tags if "id" in attributes]
    anchors = [a["href"].removeprefix("#") for a in parsed.all("a") if a["href"].startswith("#")]
    labels = [
        attributes["aria-labelledby"]
        for _, attributes in parsed.tags
        if "aria-labelledby" in attributes
    ]
    assert anchors == [
        "table-i-is-mppi-belief-safer",
        "obstacle-weight-w-obs",
        "risk",
        "provenance",
    ]
    assert len(set(ids)) == len(ids)
    assert {*anchors, *labels} <= set(ids)


def test_ids_are_unique_whatever_the_titles(folder):
    titles = ["Warnings", "Provenance", "A b", "a-b", "a b 2", "θ", "?"]
    parsed = Parsed(
        render(
            Page("t", "l", ["w"], [Section(title, []) for title in titles], [("a", "b")]), folder
        )
    )
    ids = [attributes["id"] for _, attributes in parsed.tags if "id" in attributes]
    assert len(set(ids)) == len(ids) == len(titles) + 2


def test_cells_are_those_of_the_frame(parsed):
    frames = [table_1().frame, wide_table().frame]
    cells = []
    for frame in frames:
        cells += [*frame.columns, *frame.to_numpy().ravel()]
    assert parsed.text("th", "td") == cells
    assert [th["scope"] for th in parsed.all("th")][:9] == ["col"] * 5 + ["row"] * 4
    assert parsed.text("strong") == [frames[0].iloc[3, 2]]


def test_columns_of_numbers_stand_to_the_right(parsed):
    assert [th["class"] for th in parsed.all("th")][:5] == [
        "word",
        "number",
        "number",
        "number",
        "prose",
    ]


@pytest.mark.parametrize(
    "cell",
    [
        "3",
        "-0.5",
        "1e-05",
        "24.5%",
        "46.1 ± 6.2",
        "< 0.01",
        "7 of 200",
        "nan",
        "\u22121",
        "11\u201333 %",
    ],
)
def test_numbers(cell, folder):
    assert kinds([cell, "-", ""], folder) == "number"


@pytest.mark.parametrize("cell", ["4a7f400", "3D", "theta", "[1, 2]", "info", "-"])
def test_words(cell, folder):
    assert kinds([cell], folder) == "word"


def kinds(cells: list[str], folder: Path) -> str:
    """The kind of a column, as the page has it."""
    table = PageTable("t", "c", pd.DataFrame({"name": cells}))
    return Parsed(render(Page("t", "l", [], [Section("s", [], [table])], []), folder)).all("th")[0][
        "class"
    ]


def test_hostile_text_stays_text(folder):
    page = everywhere(HOSTILE)
    parsed = Parsed(render(page, folder))
    calm = Parsed(render(everywhere("calm"), folder))
    assert [tag for tag, _ in parsed.tags] == [tag for tag, _ in calm.tags]
    assert [text for _, text in parsed.texts if HOSTILE in text][:1] == [HOSTILE]
    for tag in ("h1", "h2", "p", "li", "caption", "th", "td", "figcaption", "dt", "dd"):
        assert any(HOSTILE in text for text in parsed.text(tag)), tag


def test_files_beside_the_page_are_linked_if_they_exist(parsed):
    links = [a["href"] for a in parsed.all("a") if not a["href"].startswith("#")]
    assert links == [
        "table-1.csv",
        "table-1.tex",
        "paths.png",
        "sweep.png",
        "sweep.pdf",
        "theta%20%220.5%22.png",
    ]


def test_a_missing_picture_is_a_note(parsed):
    assert "The picture gone.gif was not found." in parsed.text("p")
    assert "One trial, animated." in parsed.text("figcaption")


def test_every_picture_has_its_description(parsed, page):
    pictures = itertools.chain.from_iterable(section.pictures for section in page.sections)
    pictures = [picture for picture in pictures if picture.file != "gone.gif"]
    assert [image["alt"] for image in parsed.all("img")] == [
        picture.alt.replace("`", "") for picture in pictures
    ]


def test_only_png_and_gif(tmp_path):
    (tmp_path / "a.GIF").write_bytes(b"GIF89a")
    page = Page("t", "l", [], [Section("s", [], pictures=[Picture("a.GIF", "moves")])], [])
    assert Parsed(render(page, tmp_path)).all("img")[0]["src"] == "data:image/gif;base64,R0lGODlh"
    with pytest.raises(ValueError, match=r"'a\.svg'"):
        render(
            page._replace(sections=[Section("s", [], pictures=[Picture("a.svg", "")])]), tmp_path
        )


def test_code_and_nothing_else(folder):
    text = "Set `a < b & c` but **not** _this_, nor ` alone"
    parsed = Parsed(render(Page("`t`", "l", [], [Section("s", [text])], []), folder))
    assert parsed.text("code") == ["a < b & c"]
    assert text.replace("`a < b & c`", "a < b & c") in parsed.text("p")
    assert parsed.text("h1") == ["`t`"]


def test_no_warnings_no_box(page, folder):
    parsed = Parsed(render(page._replace(warnings=[]), folder))
    assert not parsed.all("aside")
    assert "warnings" not in [attributes.get("id") for _, attributes in parsed.tags]


def test_an_empty_page(folder):
    parsed = Parsed(render(Page("t", "l", [], [], []), folder))
    assert not parsed.all("nav")
    assert not parsed.all("dl")


def test_the_same_page_gives_the_same_text(page, folder):
    assert render(page, folder) == render(page, folder)


in_a_browser = pytest.mark.skipif(browser.BROWSER is None, reason="no browser is installed")


@in_a_browser
@pytest.mark.parametrize("width", [360, 1280])
def test_a_browser_shows_the_page(width, page, folder, tmp_path):
    (windows,), complaints = browser.look(render(page, folder), [width], tmp_path)
    assert windows.width == width
    assert windows.content <= windows.room
    assert len(windows.pictures) == 3
    assert all(windows.pictures)
    assert all(wider > 0 for wider in windows.boxes) == (width == 360)
    assert complaints == []


@in_a_browser
def test_long_words_do_not_widen_the_page(folder, tmp_path):
    windows, complaints = browser.look(
        render(everywhere("long" * 50), folder), [360, 1280], tmp_path
    )
    assert all(window.content <= window.room for window in windows)
    assert complaints == []


@in_a_browser
def test_a_browser_would_notice(page, folder, tmp_path):
    spoilt = (
        '<img src="data:image/png;base64,AAAA" alt=""><div style="width: 2000px">wide</div>'
        "<script>x</script>"
    )
    (windows,), complaints = browser.look(
        render(page, folder).replace("</main>", f"{spoilt}</main>"), [360], tmp_path
    )
    assert windows.content > windows.room
    assert windows.pictures[-1] == 0
    assert len(complaints) == 1
    assert "Content Security Policy" in complaints[0]
