//! Common parts of all reports: a single file that works without a network, made of the components of the live page.

use super::map::PageMap;
use super::plot::{Plot, in_script};
use maud::{Markup, PreEscaped, html};
use sidehill_recording::live::components::{
    CSS, FOOT, HEAD, MAP, PLOT_JS, UPLOT_JS, VIEW_JS, WORDS,
};

/// Colours of lines, variables of the style, which has them for light and for dark pages: the palette of Okabe and Ito
/// without yellow. Each has a dash of its own in `plot.js`. The first four belong to the kinds of controllers, in their
/// order.
pub(crate) const COLOURS: [&str; 7] = [
    "--line0", "--line1", "--line2", "--line3", "--line4", "--line5", "--line6",
];

/// A report.
pub(crate) struct ReportPage<'a> {
    pub(crate) title: &'a str,
    pub(crate) subtitle: &'a str,
    /// Conclusions, one sentence each.
    pub(crate) conclusions: &'a [String],
    /// What comes first, over the whole width.
    pub(crate) summary: Markup,
    /// Legend of map and plots, which stays in sight; empty where sections have their own.
    pub(crate) legend: Markup,
    /// Plots; beside the map, where there is one.
    pub(crate) body: Markup,
    pub(crate) map: Option<PageMap>,
}

impl ReportPage<'_> {
    /// Returns the page.
    pub(crate) fn html(&self) -> String {
        let map = self.map.as_ref().filter(|map| !map.is_empty());
        let main = html! {
            div.panel {
                @for conclusion in self.conclusions {
                    p.finding { (conclusion) }
                }
                noscript { p { "The plots need JavaScript; figures and tables do not." } }
                (self.summary)
            }
            (self.legend)
            div.beside[map.is_some()] {
                @if map.is_some() { (PreEscaped(MAP)) }
                (self.body)
            }
            (PreEscaped(WORDS))
        };
        let title = html! { (self.title) }.into_string();
        let subtitle = html! { (self.subtitle) }.into_string();
        let head = HEAD.replace(
            "<title>Sidehill",
            &format!("<title>{title} \u{2013} Sidehill"),
        );
        let data = map.map_or_else(String::new, |map| {
            let json = serde_json::to_string(map).unwrap_or_else(|_| "{}".to_owned());
            format!(
                "<script id=\"runs\" type=\"application/json\">{}</script>\n",
                in_script(&json)
            )
        });
        let parts = [
            head.as_str(),
            "<style>\n",
            CSS,
            include_str!("report.css"),
            "</style>\n</head>\n",
            if map.is_some() {
                "<body class=\"map\">"
            } else {
                "<body>"
            },
            "\n<header id=\"head\">\n<p id=\"line\"><span id=\"brand\">Sidehill</span></p>\n<h1>",
            title.as_str(),
            "</h1>\n<p id=\"reason\">",
            &subtitle,
            "</p>\n</header>\n<main>\n",
            &main.into_string(),
            if map.is_some() { FOOT } else { "</main>\n" },
            &data,
            "<script>\n",
            UPLOT_JS,
            "</script>\n<script>\n",
            PLOT_JS,
            if map.is_some() { VIEW_JS } else { "" },
            include_str!("report.js"),
            if map.is_some() {
                include_str!("map.js")
            } else {
                ""
            },
            "</script>\n",
        ];
        parts.concat()
    }
}

/// Returns a section: heading, what is to be seen, and plots that share cursor and zoom with all others of their group.
pub(crate) fn section(
    title: &str,
    caption: &str,
    legend: &Markup,
    group: &str,
    plots: &[Plot],
) -> Markup {
    html! {
        section.panel {
            h2 { (title) }
            figure {
                figcaption { (caption) }
                (legend)
                div.multiples {
                    @for plot in plots {
                        (plot.markup(group))
                    }
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

/// Returns a piece of a line in its colour; the script of the page dashes it.
pub(crate) fn swatch(colour: &str) -> Markup {
    html! {
        svg.swatch viewBox="0 0 26 10" aria-hidden="true" data-colour=(colour) {
            path d="M0 5h26" fill="none" stroke={ "var(" (colour) ")" } stroke-width="3" {}
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
