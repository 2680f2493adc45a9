"""What is stated of the accuracy of products, and by what evidence: types that stages, reports and commands share."""
