//! Common parts of all reports: a single file that works without a network.

use super::plot::Plot;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Colours of lines, which `style.css` has for light and for dark pages: the palette of Okabe and Ito without yellow.
/// Each has a dash of its own in `report.js`. The first four belong to the kinds of controllers, in their order.
pub(crate) const COLOURS: [&str; 7] = [
    "var(--line0)",
    "var(--line1)",
    "var(--line2)",
    "var(--line3)",
    "var(--line4)",
    "var(--line5)",
    "var(--line6)",
];

/// The same in drawings that stand alone.
pub(crate) const PRINTED_COLOURS: [&str; 7] = [
    "#0072b2", "#d55e00", "#aa4499", "#009e73", "#e69f00", "#56b4e9", "#000000",
];

/// What the words of reports mean.
const GLOSSARY: [(&str, &str); 12] = [
    (
        "Cross-track error",
        "distance from the path, positive to its left",
    ),
    (
        "RMS",
        "root mean square: large errors count more than in an average",
    ),
    ("p50, p95, p99", "50, 95 and 99 of 100 values are smaller"),
    (
        "Steer variation",
        "sum of all changes of the steer command: large for a nervous controller",
    ),
    (
        "Traction, steer",
        "mean and half the difference of the tread speeds; positive steer turns left",
    ),
    ("ICR", "the point about which a tread turns on the ground"),
    (
        "ICRIK",
        "kinematics whose ICRs move with the slope, by roll and pitch",
    ),
    ("ICRHK", "kinematics whose ICRs do not move with the slope"),
    ("diff_drive", "kinematics without any slip"),
    ("QP", "the optimisation that an MPC solves in each cycle"),
    (
        "Fallback",
        "a cycle that drove on the plan of the cycle before",
    ),
    ("95 % interval", "the value lies in it in 95 of 100 cases"),
];

/// A report.
pub(crate) struct ReportPage<'a> {
    pub(crate) title: &'a str,
    pub(crate) subtitle: &'a str,
    /// Conclusions, one sentence each.
    pub(crate) conclusions: &'a [String],
    pub(crate) body: Markup,
    /// Further rules of style.
    pub(crate) style: &'a str,
}

impl ReportPage<'_> {
    /// Returns the page: XHTML that browsers read as HTML.
    pub(crate) fn html(&self) -> String {
        // A comment in HTML; in XHTML it keeps `<` and `&` from being markup.
        let style = |css: &str| PreEscaped(format!("/*<![CDATA[*/{css}/*]]>*/"));
        let script = |js: &str| PreEscaped(format!("//<![CDATA[\n{js}\n//]]>"));
        let page = html! {
            (DOCTYPE)
            html xmlns="http://www.w3.org/1999/xhtml" lang="en" {
                head {
                    (PreEscaped("<meta charset=\"utf-8\"/>"))
                    (PreEscaped("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>"))
                    (PreEscaped("<meta name=\"color-scheme\" content=\"light dark\"/>"))
                    title { (self.title) }
                    style { (style(include_str!("uplot/uPlot.min.css"))) }
                    style { (style(include_str!("style.css"))) (style(self.style)) }
                }
                body {
                    main {
                        h1 { (self.title) }
                        p.subtitle { (self.subtitle) }
                        @for conclusion in self.conclusions {
                            p.finding { (conclusion) }
                        }
                        details.words {
                            summary { "Words" }
                            dl {
                                @for (word, meaning) in GLOSSARY {
                                    dt { (word) }
                                    dd { (meaning) }
                                }
                            }
                        }
                        noscript { p { "The plots need JavaScript; figures and tables do not." } }
                        (self.body)
                    }
                    script { (script(include_str!("uplot/uPlot.iife.min.js"))) }
                    script { (script(include_str!("report.js"))) }
                }
            }
        };
        page.into_string()
    }
}

/// Returns a section: heading, what is to be seen, and plots that share a cursor with all others of the page.
pub(crate) fn section(title: &str, caption: &str, legend: &Markup, plots: &[Plot]) -> Markup {
    html! {
        h2 { (title) }
        figure {
            figcaption { (caption) }
            (legend)
            div.multiples {
                @for plot in plots {
                    (plot.markup("time"))
                }
            }
        }
    }
}

/// Returns names with their colours.
pub(crate) fn legend_of(names: &[(&str, &str)]) -> Markup {
    html! {
        div.legend {
            @for (name, colour) in names {
                span { (swatch(colour)) (name) }
            }
        }
    }
}

/// Returns a piece of a line in its colour; `report.js` dashes it.
pub(crate) fn swatch(colour: &str) -> Markup {
    html! {
        svg.swatch viewBox="0 0 26 6" aria-hidden="true" data-colour=(colour) {
            path d="M0,3h26" stroke=(colour) {}
        }
    }
}

/// Returns a table whose first column is text and whose others are numbers.
pub(crate) fn table(id: &str, header: &[&str], rows: &[Vec<String>]) -> Markup {
    html! {
        div.scroll role="region" aria-label=(id.replace('-', " ")) tabindex="0" {
            table id=(id) {
                thead {
                    tr {
                        @for (index, name) in header.iter().enumerate() {
                            th.name[index == 0] { (name) }
                        }
                    }
                }
                tbody {
                    @for row in rows {
                        tr {
                            @for (index, cell) in row.iter().enumerate() {
                                @if index == 0 {
                                    th.name scope="row" { (cell) }
                                } @else {
                                    td { (cell) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}
