//! The question turned round: which wavelengths give oxygen saturation with the least standard error.
//!
//! With mu_a known to the same relative error at each wavelength, the covariance of the concentrations is (A^T C^-1 A)^-1 of the chosen rows, and that of
//! StO2 follows to first order. All choices are looked at, so that the best one is the best.

use turbid_contract::{Artifact, ArtifactKind, Cells, Ctx, Error, Form, Payload, Problems, Table};

use crate::channels::listed;
use crate::condition::condition_number;
use crate::least_squares::{MOST, Square, factorise, unit};
use crate::oxygen::saturation;
use crate::params::DesignParams;
use crate::species::{Catalogue, Species};

/// Choices that are looked at: about a second of a processor.
const MOST_CHOICES: u64 = 2_000_000;

/// The best choices of wavelengths, a row each: `wavelengths_nm` (text), `StO2_se` (1), `THb_se` (uM), `NAME_se` of each chromophore in its unit,
/// `condition_number` (1). Attributes: `candidates_nm`, `choose`, `typical`, `relative_error`, `choices` (how many there are).
#[derive(Clone, Debug, PartialEq)]
pub struct Wavelengths(pub Table);

impl Payload for Wavelengths {
    const NAME: &'static str = "wavelengths";
    const KIND: ArtifactKind = ArtifactKind::Table;

    fn into_artifact(self) -> Artifact {
        Artifact::Table(self.0)
    }

    fn from_artifact(artifact: Artifact) -> Result<Self, Error> {
        match artifact {
            Artifact::Table(table) => Ok(Self(table)),
            other => Err(Error::failed(format!("a choice of wavelengths must be a table, not {:?}", other.kind()))),
        }
    }
}

/// Candidates with what the tissue absorbs there.
#[derive(Clone, Debug)]
pub struct Design {
    /// Rising, nm.
    pub candidates: Vec<f64>,
    pub choose: usize,
    relative_error: f64,
    list: usize,
    largest_condition: f64,
    names: Vec<(String, &'static str)>,
    haemoglobin: [usize; 2],
    typical: Vec<f64>,
    /// mm^-1 for one unit of each species, by candidate.
    columns: Vec<Vec<f64>>,
    /// Of the whole tissue, by candidate, mm^-1.
    mu_a: Vec<f64>,
}

/// What is looked for, where HbO2 and Hb stand among it, and what absorbs besides.
pub type Wanted<'a> = (&'a [Species], Option<[usize; 2]>, &'a [(Species, f64)]);

/// A choice of wavelengths.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Places among the candidates, rising.
    pub places: Vec<usize>,
    pub st_o2_se: f64,
    /// Of the chromophores.
    pub covariance: Square,
    pub condition: f64,
}

impl Design {
    /// Error: mistakes, at their fields. `None` with them, and where the candidates are not known yet.
    pub fn of(
        params: &DesignParams,
        (species, haemoglobin, fixed): Wanted<'_>,
        of_maps: Option<&[f64]>,
        largest_condition: f64,
        catalogue: &Catalogue,
        problems: &mut Problems,
    ) -> Option<Self> {
        let relative = params.relative_error.0;
        problems.require(relative > 0.0 && relative < 1.0, "design.relative_error", relative, "", "lie in (0, 1)");
        problems.require(params.list > 0, "design.list", f64::from(params.list), "", "be >= 1");
        let typical = catalogue.amounts(&params.typical, "design.typical", problems);
        let amount = |name: &str| typical.iter().find(|(s, _)| s.name == name).map(|(_, amount)| *amount);
        let absent: Vec<&str> = species.iter().map(|s| s.name.as_str()).filter(|name| amount(name).is_none()).collect();
        if !absent.is_empty() {
            let message = format!("typical says nothing of {}", absent.join(", "));
            problems.push_with_hint(
                "design.typical",
                message,
                "give an amount of each of `chromophores`, 0 where there is none",
            );
            return None;
        }
        let Some(haemoglobin) = haemoglobin else {
            let way_out = "write both into `chromophores`";
            problems.push_with_hint(
                "design",
                "the error of StO2 is that of HbO2 and Hb, and not both are looked for",
                way_out,
            );
            return None;
        };
        let amounts: Vec<f64> = species.iter().filter_map(|s| amount(&s.name)).collect();
        let total = amounts[haemoglobin[0]] + amounts[haemoglobin[1]];
        if total <= 0.0 {
            problems.push("design.typical", "without haemoglobin there is no StO2: HbO2 + Hb must be > 0 uM");
            return None;
        }
        let given: Vec<f64> = params.candidates.iter().map(|w| w.0).collect();
        let mut candidates = if given.is_empty() { of_maps?.to_vec() } else { given };
        candidates.sort_by(f64::total_cmp);
        if let Some(twice) = candidates.windows(2).find(|pair| pair[0] == pair[1]) {
            problems.push("design.candidates", format!("{} nm stands twice", twice[0]));
            return None;
        }
        let (choose, count) = (params.choose as usize, candidates.len());
        let least = species.len().max(2);
        if choose < least || choose > count {
            let rule =
                format!("lie in [{least}, {count}]: no fewer than the chromophores, no more than the candidates");
            problems.require(false, "design.choose", choose as f64, "", &rule);
            return None;
        }
        let choices = binomial(count as u64, choose as u64);
        if choices.is_none_or(|n| n > MOST_CHOICES) {
            let many = choices.map_or_else(|| "more than 10^18".to_owned(), |n| n.to_string());
            let message =
                format!("{choose} of {count} wavelengths can be chosen in {many} ways, more than {MOST_CHOICES}");
            problems.push_with_hint(
                "design.candidates",
                message,
                "name fewer candidates, or choose fewer or nearly all of them",
            );
            return None;
        }
        let column = |s: &Species, problems: &mut Problems| s.column(&candidates, "design.candidates", problems);
        let columns: Option<Vec<Vec<f64>>> = species.iter().map(|s| column(s, problems)).collect();
        let others = typical.iter().filter(|(s, _)| species.iter().all(|own| own.name != s.name));
        let others = others.chain(fixed.iter().filter(|(s, _)| typical.iter().all(|(own, _)| own.name != s.name)));
        let others: Option<Vec<(Vec<f64>, f64)>> = others
            .filter(|(_, amount)| *amount > 0.0)
            .map(|(s, amount)| Some((column(s, problems)?, *amount)))
            .collect();
        let (columns, others) = columns.zip(others)?;
        let mut mu_a = vec![0.0; count];
        let parts =
            columns.iter().zip(amounts.iter().copied()).chain(others.iter().map(|(column, amount)| (column, *amount)));
        for (column, amount) in parts {
            mu_a.iter_mut().zip(column).for_each(|(sum, v)| *sum += amount * v);
        }
        Some(Self {
            candidates,
            choose,
            relative_error: relative,
            list: params.list as usize,
            largest_condition,
            names: species.iter().map(|s| (s.name.clone(), s.unit)).collect(),
            haemoglobin,
            typical: amounts,
            columns,
            mu_a,
        })
    }

    /// How many choices there are.
    pub fn choices(&self) -> u64 {
        binomial(self.candidates.len() as u64, self.choose as u64).unwrap_or(u64::MAX)
    }

    /// The best choices, the best first; of equal ones that of shorter wavelengths. Those above the largest condition number are left out.
    ///
    /// Errors: the run was cancelled.
    pub fn best(&self, ctx: Ctx<'_>) -> Result<Vec<Choice>, Error> {
        let tiles = ctx.map_tiles(self.candidates.len() - self.choose + 1, |first| {
            let mut best = Vec::new();
            let mut places: Vec<usize> = (first..first + self.choose).collect();
            loop {
                self.consider(&places, &mut best);
                if !next(&mut places, self.candidates.len()) || places[0] != first {
                    break;
                }
            }
            best
        })?;
        let mut all: Vec<Choice> = tiles.into_iter().flatten().collect();
        // Stable: tiles come in the order of their first wavelength.
        all.sort_by(|a, b| a.st_o2_se.total_cmp(&b.st_o2_se));
        all.truncate(self.list);
        Ok(all)
    }

    /// Puts a choice among the best ones, where it is one.
    fn consider(&self, places: &[usize], best: &mut Vec<Choice>) {
        let Some((st_o2_se, covariance)) = self.errors(places) else { return };
        if best.len() == self.list && best.last().is_some_and(|last| st_o2_se >= last.st_o2_se) {
            return;
        }
        let chosen = |column: &Vec<f64>| places.iter().map(|&i| column[i]).collect::<Vec<f64>>();
        let condition = condition_number(&self.columns.iter().map(chosen).collect::<Vec<_>>());
        if condition <= self.largest_condition {
            let at = best.partition_point(|other| other.st_o2_se <= st_o2_se);
            best.insert(at, Choice { places: places.to_vec(), st_o2_se, covariance, condition });
            best.truncate(self.list);
        }
    }

    /// Standard error of StO2 and covariance of the concentrations; `None` where the wavelengths do not tell them apart.
    fn errors(&self, places: &[usize]) -> Option<(f64, Square)> {
        let (rows, count) = (places.len(), self.columns.len());
        let mut norms = [1.0; MOST];
        let mut whitened = Vec::with_capacity((count + 1) * rows);
        for (norm, column) in norms.iter_mut().zip(&self.columns) {
            let from = whitened.len();
            whitened.extend(places.iter().map(|&i| column[i] / (self.relative_error * self.mu_a[i])));
            *norm = whitened[from..].iter().map(|v| v * v).sum::<f64>().sqrt();
            whitened[from..].iter_mut().for_each(|v| *v /= *norm);
        }
        whitened.resize((count + 1) * rows, 0.0);
        let mut covariance = factorise(&mut whitened, rows, count)?.covariance(&unit(count));
        for (i, row) in covariance.iter_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(k, v)| *v /= norms[i] * norms[k]);
        }
        let [a, b] = self.haemoglobin;
        let of_both = [[covariance[a][a], covariance[a][b]], [covariance[b][a], covariance[b][b]]];
        let (_, variance) = saturation(self.typical[a], self.typical[b], Some(of_both))?;
        Some((variance?.sqrt(), covariance))
    }

    /// Columns of the table, name and unit.
    fn table_columns(&self) -> Vec<(String, &'static str)> {
        let own = self.names.iter().map(|(name, unit)| (format!("{name}_se"), *unit));
        let before =
            [("wavelengths_nm", ""), ("StO2_se", "1"), ("THb_se", "uM")].map(|(name, unit)| (name.to_owned(), unit));
        before.into_iter().chain(own).chain([("condition_number".to_owned(), "1")]).collect()
    }

    pub fn form(&self) -> Form {
        let columns = self.table_columns();
        let columns: Vec<(&str, &str)> = columns.iter().map(|(name, unit)| (name.as_str(), *unit)).collect();
        Form::table(None, &columns)
    }

    /// Errors: the run was cancelled, or no choice tells the chromophores apart.
    pub fn table(&self, ctx: Ctx<'_>) -> Result<Wavelengths, Error> {
        let best = self.best(ctx)?;
        if best.is_empty() {
            let what = format!("no choice of {} wavelengths tells the chromophores apart", self.choose);
            return Err(Error::failed_with_hint(
                what,
                "choose more, look for fewer chromophores, or raise `largest_condition`",
            ));
        }
        let [a, b] = self.haemoglobin;
        let of = |f: &dyn Fn(&Choice) -> f64| Cells::F64(best.iter().map(f).collect());
        let at = |c: &Choice| listed(&c.places.iter().map(|&i| self.candidates[i]).collect::<Vec<_>>());
        let mut cells = vec![
            Cells::Text(best.iter().map(at).collect()),
            of(&|c| c.st_o2_se),
            of(&|c| (c.covariance[a][a] + c.covariance[b][b] + 2.0 * c.covariance[a][b]).max(0.0).sqrt()),
        ];
        cells.extend((0..self.names.len()).map(|k| of(&|c| c.covariance[k][k].sqrt())));
        cells.push(of(&|c| c.condition));
        let mut table = Table::default();
        self.table_columns().into_iter().zip(cells).for_each(|((name, unit), cells)| table.push(name, unit, cells));
        let typical = self.names.iter().zip(&self.typical).map(|((name, _), amount)| (name.clone(), (*amount).into()));
        table.attributes.insert("candidates_nm".to_owned(), self.candidates.clone().into());
        table.attributes.insert("choose".to_owned(), self.choose.into());
        table.attributes.insert("typical".to_owned(), serde_json::Value::Object(typical.collect()));
        table.attributes.insert("relative_error".to_owned(), self.relative_error.into());
        table.attributes.insert("choices".to_owned(), self.choices().into());
        Ok(Wavelengths(table))
    }
}

/// The next choice in the order of the candidates; `false` after the last.
fn next(places: &mut [usize], count: usize) -> bool {
    let n = places.len();
    let Some(i) = (0..n).rev().find(|&i| places[i] < count - n + i) else { return false };
    places[i] += 1;
    for k in i + 1..n {
        places[k] = places[k - 1] + 1;
    }
    true
}

/// n over k; `None` where it is too large for a number.
fn binomial(n: u64, k: u64) -> Option<u64> {
    let k = k.min(n - k);
    (0..k).try_fold(1_u64, |product, i| Some(product.checked_mul(n - i)? / (i + 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_choice_comes_once_and_in_order() {
        let (mut places, mut seen) = (vec![0, 1, 2], Vec::new());
        loop {
            seen.push(places.clone());
            if !next(&mut places, 6) {
                break;
            }
        }
        assert!(seen.len() == 20 && binomial(6, 3) == Some(20) && seen.is_sorted() && seen[19] == [3, 4, 5]);
        assert_eq!((binomial(40, 20), binomial(200, 100), binomial(7, 7)), (Some(137_846_528_820), None, Some(1)));
    }
}
