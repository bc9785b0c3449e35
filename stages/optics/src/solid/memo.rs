//! The last answers to a question that costs much and is asked again and again.

use std::sync::Mutex;

/// A cache of two answers. It is no part of what it belongs to: copies start without, and all are equal.
#[derive(Debug)]
pub(super) struct Memo<Question, Answer>(Mutex<Vec<(Question, Answer)>>);

const MOST: usize = 2;

impl<Question: PartialEq, Answer: Clone> Memo<Question, Answer> {
    pub(super) fn get(&self, question: Question, find: impl FnOnce(&Question) -> Answer) -> Answer {
        // A thread that failed while it looked has left nothing behind.
        let mut kept = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, answer)) = kept.iter().find(|(known, _)| *known == question) {
            return answer.clone();
        }
        let answer = find(&question);
        if kept.len() == MOST {
            kept.remove(0);
        }
        kept.push((question, answer.clone()));
        answer
    }
}

impl<Question, Answer> Default for Memo<Question, Answer> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<Question, Answer> Clone for Memo<Question, Answer> {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl<Question, Answer> PartialEq for Memo<Question, Answer> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
