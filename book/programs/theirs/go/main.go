// Go's side of the page for those who know Go.
package main

import (
	"fmt"
	"sync"
	"time"
)

// ANCHOR: pipeline
func numbers(output chan<- int) {
	defer close(output)
	for n := 1; n <= 3; n++ {
		output <- n
	}
}

func squares(input <-chan int, output chan<- int) {
	defer close(output)
	for n := range input {
		output <- n * n
	}
}

// ANCHOR_END: pipeline

// ANCHOR: select
func watch(input <-chan int, done <-chan struct{}) string {
	for {
		select {
		case n := <-input:
			fmt.Println("got", n)
		case <-done:
			return "done"
		case <-time.After(20 * time.Millisecond):
			return "nothing came"
		}
	}
}

// ANCHOR_END: select

// ANCHOR: workers
func share() int {
	jobs, sums := make(chan int), make(chan int, 3)
	var workers sync.WaitGroup
	for range [3]int{} {
		workers.Add(1)
		go func() {
			defer workers.Done()
			sum := 0
			for n := range jobs {
				sum += n
			}
			sums <- sum
		}()
	}
	for n := 1; n <= 10; n++ {
		jobs <- n
	}
	close(jobs)
	workers.Wait()
	return <-sums + <-sums + <-sums
}

// ANCHOR_END: workers

// ANCHOR: main
func main() {
	a, b := make(chan int), make(chan int)
	go numbers(a)
	go squares(a, b)
	for n := range b {
		fmt.Println(n)
	}
	// ANCHOR_END: main

	input, done := make(chan int), make(chan struct{})
	fmt.Println(watch(input, done))
	fmt.Println("the sum is", share())
}
